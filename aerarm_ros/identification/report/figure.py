"""Curves of several joints over time, one above the other."""

from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.pages.html_text import Html
from aerarm_ros.pages.plots import figure_html, plain_text

Array = npt.NDArray[np.float64]

MOST_POINTS = 1000
"""Of a curve: about what a screen shows."""

_ROW_HEIGHT = 190  # [px] of one joint's axes
# What is measured is a broad pale band that stays visible under the thin lines on top of it.
_LINES = {
    'measured': {'color': '#a9bdd6', 'width': 5.0},
    'predicted': {'color': '#0b4fa3', 'width': 1.3},
    'reference': {'color': '#d0672b', 'width': 1.3},
    'residual': {'color': '#b3261e', 'width': 1.3},
}
_CLOUD = {'color': '#7d94b5', 'size': 4}  # of single points


class StackedFigure:
    """Curves over time, one pair of axes a joint, under a common time axis.

    Parameters
    ----------
    rows : sequence of str
        Titles of the axes, top to bottom.
    unit : str
        Of all vertical axes.
    x_title : str
        Of the common axis.
    logarithmic : bool
        All axes.
    most : int
        Points of a curve that are kept, evenly spread.

    Attributes
    ----------
    traces : list of dict
        The curves so far, as the plotting script takes them.
    """

    def __init__(
        self,
        rows: tuple[str, ...],
        unit: str,
        x_title: str = 'time [s]',
        logarithmic: bool = False,
        most: int = MOST_POINTS,
    ) -> None:
        self._most = most
        self._kind = 'log' if logarithmic else 'linear'
        self._rows = rows
        self._unit = unit
        self._x_title = x_title
        self.traces: list[dict[str, Any]] = []

    def add(
        self,
        row: int,
        x: Array,
        y: Array,
        name: str,
        role: str,
        dash: str = 'solid',
        marked: bool = False,
    ) -> None:
        """Add a curve.

        Parameters
        ----------
        row : int
        x, y : (M,) ndarray
            Thinned out to `most`.
        name : str
            In the legend, once.
        role : str
            'measured', 'predicted', 'reference' or 'residual': colour and width of the line;
            'cloud': single points.
        dash : str
            Of the line: 'solid', 'dot', 'dash'.
        marked : bool
            Whether the line's points are shown.
        """
        if role == 'cloud':
            look: dict[str, Any] = {'mode': 'markers', 'marker': _CLOUD}
        else:
            mode = 'lines+markers' if marked else 'lines'
            look = {'mode': mode, 'line': {**_LINES[role], 'dash': dash}}
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

    def html(self, identifier: str) -> Html:
        """Return the figure as a division and the script that draws it."""
        layout = self._layout()
        return figure_html(identifier, self.traces, layout)

    def _layout(self) -> dict[str, Any]:
        count = len(self._rows)
        layout: dict[str, Any] = {
            'height': _ROW_HEIGHT * count + 90,
            'margin': {'l': 75, 'r': 15, 't': 30, 'b': 45},
            'legend': {'orientation': 'h', 'y': 1.0 + 0.12 / count, 'yanchor': 'bottom'},
            'hovermode': 'x unified',
            'xaxis': {
                'title': {'text': self._x_title},
                'anchor': f'y{count if count > 1 else ""}',
                'type': self._kind,
            },
        }
        gap = 0.2 / count
        for row, title in enumerate(self._rows):
            top = 1.0 - row / count
            layout[f'yaxis{"" if row == 0 else row + 1}'] = {
                'domain': [max(0.0, top - 1.0 / count + gap), top],
                'title': {'text': f'{plain_text(title)} [{self._unit}]'},
                'type': self._kind,
            }
        return layout


def _places(x: Array) -> dict[str, Any]:
    """Return where points lie: first and distance if that is the same for all."""
    if len(x) > 2 and np.ptp(np.diff(x)) <= 1e-6 * np.ptp(x):
        return {'x0': float(f'{x[0]:.8g}'), 'dx': float(f'{(x[-1] - x[0]) / (len(x) - 1):.8g}')}
    return {'x': _short(x)}


def _short(values: Array) -> list[float]:
    return [float(f'{value:.5g}') for value in values]
