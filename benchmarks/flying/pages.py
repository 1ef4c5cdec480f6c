"""Parts of the pages that the benchmarks write."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerarm_ros.description.resources import write_whole
from aerarm_ros.pages.html_text import Html, origin, page
from aerarm_ros.pages.plots import figure_html, plotting_script

_THINNED = 8  # draw one in so many states


def write_page(path: Path, title: str, body: Iterable[str]) -> None:
    """Write a page and print its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, page(title, plotting_script(), body, origin()))
    print(f'Page      {path}')


def figure(
    identifier: str, traces: list[dict[str, Any]], x: str, y: str, is_log: bool = False, **more: Any
) -> Html:
    """Return a plot with its legend below; further arguments are Plotly's layout."""
    layout = {
        'height': 420,
        'margin': {'l': 60, 'r': 10, 't': 30, 'b': 90},
        'xaxis': {'title': {'text': x}},
        'yaxis': {'title': {'text': y}, 'type': 'log' if is_log else 'linear'},
        'legend': {'orientation': 'h', 'y': -0.18, 'yanchor': 'top'},  # as wide as the plot
        **more,
    }
    return figure_html(identifier, traces, layout)


def time_plot(
    identifier: str, flown: Mapping[str, Any], values: Mapping[str, np.ndarray], title: str,
    is_log: bool = False, **more: Any,
) -> Html:  # fmt: skip
    """Return a plot of values over the times of records, by the names of the records."""
    traces = [
        {
            'type': 'scatter',
            'mode': 'lines',
            'name': name,
            'x': np.round(record.times[::_THINNED], 3).tolist(),
            'y': np.round(values[name][::_THINNED], 3).tolist(),
        }
        for name, record in flown.items()
    ]
    return figure(identifier, traces, 't [s]', title, is_log, **more)
