"""Page with plots and replays of flights with the tool held in the world or on a wall."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from flying.flight_record import FlightRecord
from flying.flight_replay import replay
from flying.holding_bench import HoldingRecord
from flying.holding_case import CASES, HELD
from flying.pushing_bench import PushingRecord
from flying.pushing_case import PUSHES

from aerarm_ros.description.resources import write_whole
from aerarm_ros.pages.html_text import Html, origin, page, paragraph, section, table
from aerarm_ros.pages.plots import figure_html, plotly_figure, plotting_script

PUSH_COLUMNS = (
    'flight', 'force error RMS [N]', 'peak [N]', 'tool error across RMS [mm]', 'stop [mm]',
    'goal [N] or [mm]', 'status',
)  # fmt: skip
COLUMNS = (
    'flight', 'tool RMS [mm]', 'largest', 'drone RMS [mm]', 'largest', 'goal [mm]',
    'target beyond reach [mm]', 'drone could still move [mm]', 'largest tilt [deg]', 'status',
)  # fmt: skip
_THINNED = 8
_REPLAYED, _REPLAYED_PUSH = 'tool at rest', 'push and slide, 1e3 N/m'


def write_page(
    path: Path,
    records: Mapping[str, HoldingRecord | str],
    pushes: Mapping[str, PushingRecord | str],
    note: str,
) -> None:
    """Write the page, and print its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, holding_page(records, pushes, note))
    print(f'Page      {path}')


def holding_page(
    records: Mapping[str, HoldingRecord | str], pushes: Mapping[str, PushingRecord | str], note: str
) -> str:
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
    if pushes:
        body += _pushes(pushes)
    return page(
        'The tool keeps its position while its drone moves', plotting_script(), body, origin()
    )


def _row(name: str, record: HoldingRecord | str) -> tuple[object, ...]:
    goal = CASES[name].goal
    asked = goal if np.isfinite(goal) else None
    if isinstance(record, str):
        return name, *[None] * 4, asked, *[None] * 3, record
    return name, *record.figures(), asked, *record.bound, record.diagnostics


def _pushes(pushes: Mapping[str, PushingRecord | str]) -> list[Html]:
    """Return the sections about the force on a wall."""
    flown = {name: x for name, x in pushes.items() if isinstance(x, PushingRecord)}
    flights = {name: record.flight for name, record in flown.items()}
    forces = {name: record.forces for name, record in flown.items()}
    shown = {name: _flight(flights[name]) for name in (_REPLAYED_PUSH,) if name in flown}
    rows = [_push_row(*item) for item in pushes.items()]
    parts = [section('Force on a wall', table(PUSH_COLUMNS, rows, []))]
    if flown:
        parts.append(section('Force over time', _plot(flights, forces, 'force [N]', 'force')))
    for name in shown:
        drawn = plotly_figure(replay(shown, PUSHES[name].flown, larger=1.0))
        parts.append(section(f'Replay: {name}', drawn))
    return parts


def _push_row(name: str, record: PushingRecord | str) -> tuple[object, ...]:
    goal = PUSHES[name].goal
    asked = goal if np.isfinite(goal) else None
    if isinstance(record, str):
        return name, *[None] * 4, asked, record
    figures = [None if np.isnan(value) else round(value, 2) for value in record.figures()]
    return name, *figures, asked, record.flight.diagnostics


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
        'yaxis': {'title': {'text': title}, 'type': 'linear' if name == 'force' else 'log'},
        'legend': {'orientation': 'h', 'y': -0.18, 'yanchor': 'top'},
    }
    return figure_html(name, traces, layout)
