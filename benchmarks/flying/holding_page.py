"""Page with plots and a replay of flights with the tool held in the world."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from flying.flight_record import FlightRecord
from flying.flight_replay import replay
from flying.holding_bench import HoldingRecord
from flying.holding_case import CASES, HELD

from aerarm_ros.description.resources import write_whole
from aerarm_ros.pages.html_text import Html, origin, page, paragraph, section, table
from aerarm_ros.pages.plots import figure_html, plotly_figure, plotting_script

COLUMNS = 'flight', 'tool RMS [mm]', 'largest', 'drone RMS [mm]', 'largest', 'goal [mm]', 'status'
_THINNED = 8
_REPLAYED = 'tool at rest'


def write_page(path: Path, records: Mapping[str, HoldingRecord | str], note: str) -> None:
    """Write the page, and print its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, holding_page(records, note))
    print(f'Page      {path}')


def holding_page(records: Mapping[str, HoldingRecord | str], note: str) -> str:
    """Return the page as HTML; a failed flight is represented by its reason."""
    flown = {name: x for name, x in records.items() if isinstance(x, HoldingRecord)}
    errors = {name: 1e3 * np.linalg.norm(x.tools - x.targets, axis=1) for name, x in flown.items()}
    places = {name: 1e3 * np.linalg.norm(x.places, axis=1) for name, x in flown.items()}
    body = [
        paragraph(note, 'lead'),
        section('Figures', table(COLUMNS, [_row(*item) for item in records.items()], [])),
        section(
            'Over time',
            _plot(flown, errors, 'tool error [mm]', 'tool'),
            _plot(flown, places, 'drone error [mm]', 'drone'),
        ),
    ]
    held = [name for name in flown if CASES[name].law == HELD][:1]
    shown = {name: _flight(flown[name]) for name in (_REPLAYED, *held) if name in flown}
    if shown:
        drawn = plotly_figure(replay(shown, CASES[_REPLAYED].flown, larger=1.0))
        body.append(section('Replay', drawn))
    return page(
        'The tool keeps its position while its drone moves', plotting_script(), body, origin()
    )


def _row(name: str, record: HoldingRecord | str) -> tuple[object, ...]:
    goal = CASES[name].goal
    asked = goal if np.isfinite(goal) else None
    if isinstance(record, str):
        return name, *[None] * 4, asked, record
    return name, *record.figures(), asked, record.diagnostics


def _flight(record: HoldingRecord) -> FlightRecord:
    """Return a flight whose replay starts one second before time zero."""
    nothing = np.zeros((0, 1))
    return FlightRecord(
        record.times, record.places, record.attitudes, record.postures, nothing[:, 0], nothing
    )


def _plot(
    flown: Mapping[str, HoldingRecord], values: Mapping[str, np.ndarray], title: str, name: str
) -> Html:
    traces = [
        {
            'type': 'scatter',
            'mode': 'lines',
            'name': case,
            'x': np.round(record.times[::_THINNED], 3).tolist(),
            'y': np.round(values[case][::_THINNED], 3).tolist(),
        }
        for case, record in flown.items()
    ]
    layout = {
        'height': 420,
        'margin': {'l': 60, 'r': 10, 't': 30, 'b': 90},
        'xaxis': {'title': {'text': 't [s]'}},
        'yaxis': {'title': {'text': title}, 'type': 'log'},
        'legend': {'orientation': 'h', 'y': -0.18, 'yanchor': 'top'},
    }
    return figure_html(name, traces, layout)
