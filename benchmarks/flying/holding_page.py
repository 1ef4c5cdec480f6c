"""Page with plots and replays of flights with the tool held in the world or on a wall."""

from collections.abc import Mapping

import numpy as np
from flying.holding_bench import HoldingRecord, PushingRecord
from flying.holding_case import CASES, HELD, PUSHES
from flying.pages import replay, time_plot

from aerarm_ros.pages.html_text import Html, paragraph, section, table
from aerarm_ros.pages.plots import plotly_figure

PUSH_COLUMNS = (
    'flight', 'force error RMS [N]', 'peak [N]', 'tool error across RMS [mm]', 'stop [mm]',
    'goal [N] or [mm]', 'status',
)  # fmt: skip
COLUMNS = (
    'flight', 'tool RMS [mm]', 'largest', 'drone RMS [mm]', 'largest', 'target beyond reach [mm]',
    'drone could still move [mm]', 'largest tilt [deg]', 'largest heading [deg]', 'goal [mm]',
    'status',
)  # fmt: skip
_REPLAYED, _REPLAYED_PUSH = 'tool at rest', 'push and slide, 1e3 N/m'


def holding_page(
    records: Mapping[str, HoldingRecord | str], pushes: Mapping[str, PushingRecord | str], note: str
) -> list[Html]:
    """Return the sections of the page; a failed flight is represented by its reason."""
    flown = {name: x for name, x in records.items() if isinstance(x, HoldingRecord)}
    errors = {name: x.tool_errors for name, x in flown.items()}
    places = {name: 1e3 * np.linalg.norm(x.places, axis=1) for name, x in flown.items()}
    body = [
        paragraph(note, 'lead'),
        section('Figures', table(COLUMNS, [_row(*item) for item in records.items()], [])),
        section(
            'Over time',
            time_plot('tool', flown, errors, 'tool error [mm]', is_log=True),
            time_plot('drone', flown, places, 'drone error [mm]', is_log=True),
        ),
    ]
    held = [name for name in flown if CASES[name].law == HELD][:1]
    shown = {name: flown[name] for name in (_REPLAYED, *held) if name in flown}
    if shown:
        drawn = plotly_figure(replay(shown, CASES[_REPLAYED].flown, larger=1.0))
        body.append(section('Replay', drawn))
    if pushes:
        body += _pushes(pushes)
    return body


def _row(name: str, record: HoldingRecord | str) -> tuple[object, ...]:
    goal = (PUSHES.get(name) or CASES[name]).goal
    asked = goal if np.isfinite(goal) else None
    if isinstance(record, str):
        count = len(COLUMNS if name in CASES else PUSH_COLUMNS) - 3
        return name, *[None] * count, asked, record
    figures = [None if np.isnan(value) else round(value, 2) for value in record.figures()]
    return name, *figures, asked, record.diagnostics


def _pushes(pushes: Mapping[str, PushingRecord | str]) -> list[Html]:
    """Return the sections about the force on a wall."""
    flown = {name: x for name, x in pushes.items() if isinstance(x, PushingRecord)}
    forces = {name: record.forces for name, record in flown.items()}
    shown = {name: flown[name] for name in (_REPLAYED_PUSH,) if name in flown}
    rows = [_row(*item) for item in pushes.items()]
    parts = [section('Force on a wall', table(PUSH_COLUMNS, rows, []))]
    if flown:
        parts.append(section('Force over time', time_plot('force', flown, forces, 'force [N]')))
    for name in shown:
        drawn = plotly_figure(replay(shown, PUSHES[name].flown, larger=1.0))
        parts.append(section(f'Replay: {name}', drawn))
    return parts
