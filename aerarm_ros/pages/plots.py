"""Plots for HTML reports, drawn by the browser with an embedded copy of plotly."""

from __future__ import annotations

import base64
import gzip
import importlib.util
import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import Html


def figure_html(identifier: str, traces: list[dict[str, Any]], layout: dict[str, Any]) -> Html:
    """Return an HTML element, with a script that draws a plot in this element.

    Parameters
    ----------
    identifier : str
        Identifier of the HTML element, with letters, digits and hyphens.
    traces, layout
        Traces and layout as plotly.js expects them.
    """
    options = {'responsive': True, 'displaylogo': False}
    arguments = ', '.join(_script(value) for value in (identifier, traces, layout, options))
    return Html(
        f'<div class="figure" id="{identifier}"></div>\n'
        f'<script>plotting.then(() => Plotly.newPlot({arguments}));</script>\n'
    )


def plotly_figure(figure: Any) -> Html:
    """Convert a plotly figure to a part of an HTML report."""
    drawn = figure.to_html(full_html=False, include_plotlyjs=False)
    return Html(f'<div class="figure">{drawn}</div>\n')


def plotting_script() -> Html:
    """Return plotly.js as an inline script, so that reports open without network.

    Raises
    ------
    ValueError
        If plotly is not installed.
    """
    # Located without import, because only its JavaScript is needed and the import is slow.
    found = importlib.util.find_spec('plotly')
    if found is None or not found.submodule_search_locations:
        raise ValueError(
            'the Python package plotly is not installed: install aerarm_ros again, with its '
            'dependencies'
        )
    path = Path(found.submodule_search_locations[0]) / 'package_data' / 'plotly.min.js'
    packed = base64.b64encode(_compressed(path)).decode()
    script = Path(__file__).with_name('plots.js').read_text(encoding='utf-8')
    return Html(f'<script>\n{script.replace("PACKED", packed)}</script>\n')


@lru_cache(maxsize=1)
def _compressed(path: Path) -> bytes:
    # A higher compression level takes 50 % longer for 0.2 % less size.
    return gzip.compress(path.read_bytes(), compresslevel=6, mtime=0)


def plain_text(text: str) -> str:
    """Escape a text for plotly.js, which would interpret some HTML tags in it."""
    return text.replace('&', '&amp;').replace('<', '&lt;').replace('>', '&gt;')


def _script(value: object) -> str:
    """Convert a value to JSON without characters that could end an HTML script element."""
    text = json.dumps(value, separators=(',', ':'))
    return text.replace('<', '\\u003c').replace('>', '\\u003e').replace('&', '\\u0026')


MOST_POINTS = 1000
"""Largest number of points per curve, about the number of pixels across a screen."""

_ROW_HEIGHT = 190  # [px] height of one joint's axes
# Measured curves are broad and pale, so that they stay visible under thin lines.
_LINES = {
    'measured': {'color': '#a9bdd6', 'width': 5.0},
    'predicted': {'color': '#0b4fa3', 'width': 1.3},
    'reference': {'color': '#d0672b', 'width': 1.3},
    'residual': {'color': '#b3261e', 'width': 1.3},
}
_CLOUD = {'color': '#7d94b5', 'size': 4}  # markers of single points


class StackedFigure:
    """Figure with one plot per joint, stacked vertically, with a common horizontal axis.

    Parameters
    ----------
    rows : sequence of str
        Titles of the axes, top to bottom.
    unit : str
        Unit of all vertical axes.
    x_title : str
        Title of the common axis.
    most : int
        Largest number of points per curve, evenly spread.

    Attributes
    ----------
    traces : list of dict
        Curves added so far, in the plotting script's format.
    """

    def __init__(
        self, rows: tuple[str, ...], unit: str, x_title: str = 'time [s]', most: int = MOST_POINTS
    ) -> None:
        self._most = most
        self._rows = rows
        self._unit = unit
        self._x_title = x_title
        self.traces: list[dict[str, Any]] = []

    def add(self, row: int, x: Array, y: Array, name: str, role: str, dash: str = 'solid') -> None:
        """Add a curve to the plot of one joint.

        Parameters
        ----------
        row : int
            Index of the plot.
        x, y : (M,) ndarray
            Points, reduced to `most`.
        name : str
            Name in the legend, shown once.
        role : str
            'measured', 'predicted', 'reference' or 'residual' determine colour and width of the
            line; 'cloud' means single points.
        dash : str
            Line style: 'solid', 'dot', 'dash'.
        """
        if role == 'cloud':
            look: dict[str, Any] = {'mode': 'markers', 'marker': _CLOUD}
        else:
            look = {'mode': 'lines', 'line': {**_LINES[role], 'dash': dash}}
        step = max(1, -(-len(x) // self._most))
        suffix = '' if row == 0 else str(row + 1)
        self.traces.append(
            {
                'type': 'scatter',
                **look,
                **_places(x[::step]),
                'y': _short(y[::step]),
                'name': name,
                'legendgroup': name,
                'showlegend': not any(trace['name'] == name for trace in self.traces),
                'xaxis': 'x',
                'yaxis': f'y{suffix}',
            }
        )

    def html(self, identifier: str, shapes: Sequence[dict[str, Any]] = ()) -> Html:
        """Return the figure as an HTML division with the script that draws it.

        Parameters
        ----------
        shapes
            Shapes to draw over the curves, as plotly.js expects them.
        """
        count = len(self._rows)
        layout: dict[str, Any] = {
            'height': _ROW_HEIGHT * count + 90,
            'shapes': list(shapes),
            'margin': {'l': 75, 'r': 15, 't': 30, 'b': 45},
            'legend': {'orientation': 'h', 'y': 1.0 + 0.12 / count, 'yanchor': 'bottom'},
            'hovermode': 'x unified',
            'xaxis': {'title': {'text': self._x_title}, 'anchor': f'y{count if count > 1 else ""}'},
        }
        gap = 0.2 / count
        for row, title in enumerate(self._rows):
            top = 1.0 - row / count
            layout[f'yaxis{"" if row == 0 else row + 1}'] = {
                'domain': [max(0.0, top - 1.0 / count + gap), top],
                'title': {'text': f'{plain_text(title)} [{self._unit}]'},
            }
        return figure_html(identifier, self.traces, layout)


def _places(x: Array) -> dict[str, Any]:
    """Return equidistant x positions as first value and spacing, other x positions as a list."""
    if len(x) > 2 and np.ptp(np.diff(x)) <= 1e-6 * np.ptp(x):
        return {'x0': float(f'{x[0]:.8g}'), 'dx': float(f'{(x[-1] - x[0]) / (len(x) - 1):.8g}')}
    return {'x': _short(x)}


def _short(values: Array) -> list[float]:
    return [float(f'{value:.5g}') for value in values]
