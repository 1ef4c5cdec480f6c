"""Plots of an HTML report, which the browser draws with an embedded copy of plotly."""

from __future__ import annotations

import base64
import gzip
import importlib.util
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from aerarm_ros.pages.html_text import Html


def figure_html(identifier: str, traces: list[dict[str, Any]], layout: dict[str, Any]) -> Html:
    """Return an HTML element, and the script that draws a plot into it.

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
    """Return plotly.js as an inline script, so that a report needs no network.

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
