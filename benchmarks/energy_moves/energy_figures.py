"""Energy that planned motions save and accuracy of the predicted energy, as text and page."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from energy_moves.energy_bench import PLANNED, SETTLE, TRAPEZOID, Taken
from flying.pages import figure

from aerarm_ros.pages.html_text import Html, bullets, paragraph, section, table
from aerarm_ros.planner.motion_plan import QUINTIC

SAVING, PREDICTED, WITHIN = 0.45, 0.9, 0.1
OTHERS = (QUINTIC, TRAPEZOID)
GOALS = (
    f'Goals: median saving of {100 * SAVING:.0f} % relative to the quintic, no move worse; '
    f'prediction within 10 % for {100 * PREDICTED:.0f} % of the moves; tracking error not above '
    'that of the quintic.'
)
COLUMNS = (
    'median energy of a move [J]',
    'predicted within 10 % [%]',
    'RMS error [mrad]',
    'RMS error of the median move [mrad]',
    'largest error [mrad]',
    'battery [min]',
)
SAVINGS = ('median [%]', 'least [%]', 'tenth [%]', 'nine tenths [%]', 'moves with higher energy')


@dataclass(frozen=True, eq=False)
class EnergyFigures:
    """Results by shape, one row per move that was played in every shape."""

    by_shape: dict[str, list[Taken]]

    def column(self, shape: str, field: str) -> np.ndarray:
        """Return one field of all moves, (moves,)."""
        return np.array([getattr(one, field) for one in self.by_shape[shape]])

    def saving(self, other: str) -> np.ndarray:
        """Return the measured fraction (moves,) that planned motions save over another shape."""
        return 1.0 - self.column(PLANNED, 'measured') / self.column(other, 'measured')

    def well_predicted(self, shape: str) -> float:
        """Return the fraction of moves whose prediction is within 10 % of the measurement."""
        predicted, measured = self.column(shape, 'predicted'), self.column(shape, 'measured')
        return float((np.abs(predicted - measured) <= WITHIN * measured).mean())

    def battery_minutes(self, shape: str, standby: float, watt_hours: float) -> float:
        """Return the time for which a battery supplies arm and boards [min]."""
        seconds = (self.column(shape, 'duration') + SETTLE).sum()  # duration of the measurement
        power = self.column(shape, 'measured').sum() / seconds
        return float(60.0 * watt_hours / (power + standby))

    def rows(self, standby: float, watt_hours: float) -> list[tuple[Any, ...]]:
        """Return one row per shape: its name, and a number for each of `COLUMNS`."""
        return [
            (
                shape,
                float(np.median(self.column(shape, 'measured'))),
                100.0 * self.well_predicted(shape),
                float(np.sqrt((self.column(shape, 'rms') ** 2).mean())),
                float(np.median(self.column(shape, 'rms'))),
                float(self.column(shape, 'largest').max()),
                self.battery_minutes(shape, standby, watt_hours),
            )
            for shape in self.by_shape
        ]

    def savings(self) -> list[tuple[Any, ...]]:
        """Return one row per other shape: its name, and a number for each of `SAVINGS`."""
        rows = []
        for other in OTHERS:
            saving = 100.0 * self.saving(other)
            low, middle, high = np.percentile(saving, (10, 50, 90)).tolist()
            worse = int((saving < 0.0).sum())
            rows.append((other, middle, float(saving.min()), low, high, worse))
        return rows

    def text(self, standby: float, watt_hours: float) -> str:
        """Return the figures and the goals as text."""
        lines = []
        tables = (
            ('', COLUMNS, self.rows(standby, watt_hours)),
            ('saving relative to ', SAVINGS, self.savings()),
        )
        for what, columns, rows in tables:
            for name, *values in rows:
                shown = [f'{column} {x:.2f}' for column, x in zip(columns, values, strict=True)]
                lines.append(f'{what}{name}: {", ".join(shown)}')
        return '\n'.join([*lines, GOALS])


def figures(results: list[Taken]) -> EnergyFigures:
    """Return the figures of results in arbitrary order."""
    shapes: dict[str, dict[int, Taken]] = {}
    for one in results:
        shapes.setdefault(one.shape, {})[one.pair] = one
    common = sorted(set.intersection(*(set(rows) for rows in shapes.values())))
    return EnergyFigures({shape: [rows[k] for k in common] for shape, rows in shapes.items()})


def energy_page(
    found: EnergyFigures, standby: float, watt_hours: float, note: str, refused: list[str]
) -> list[str]:
    """Return the page of the energy campaign as HTML.

    Parameters
    ----------
    found
        Measured figures.
    standby
        Power of the boards without motor current [W].
    watt_hours
        Energy of the battery [Wh].
    note
        Description of the played moves.
    refused
        Moves that were not completed, with the reason.
    """
    names = list(found.by_shape)
    rows = found.rows(standby, watt_hours)
    body = [
        paragraph(note, 'lead'),
        paragraph(GOALS, 'note'),
        section('Energy per move', table(['shape', *COLUMNS], rows, [names.index(PLANNED)])),
        section('Saving by planning', table(['than the', *SAVINGS], found.savings())),
        section('Energy of a move', _against(found)),
        section('Saving and duration', _saving(found)),
        section('Predicted and measured', _predicted(found)),
        section('Tracking error', _tracking(found)),
    ]
    if refused:
        body.append(section('Not played', bullets(refused)))
    return body


def _against(found: EnergyFigures) -> Html:
    planned = found.column(PLANNED, 'measured')
    top = float(found.column(QUINTIC, 'measured').max())
    traces = [_points(other, found.column(other, 'measured'), planned) for other in OTHERS]
    for name, share in (('as much', 1.0), ('half', 0.5)):
        line = {'dash': 'dash', 'width': 1}
        ends: dict[str, Any] = {'x': [0.0, top], 'y': [0.0, share * top], 'line': line}
        traces.append({'type': 'scatter', 'mode': 'lines', 'name': name, **ends})
    return figure('against', traces, 'other shape, same duration [J]', 'planned [J]')


def _saving(found: EnergyFigures) -> Html:
    duration = found.column(PLANNED, 'duration')
    traces = [_points(f'than {x}', duration, 100.0 * found.saving(x)) for x in OTHERS]
    return figure('saving', traces, 'duration [s]', 'less [%]')


def _predicted(found: EnergyFigures) -> Html:
    traces = []
    for shape in found.by_shape:
        measured = found.column(shape, 'measured')
        off = 100.0 * (found.column(shape, 'predicted') / measured - 1.0)
        traces.append(_points(shape, measured, off))
    return figure('predicted', traces, 'measured [J]', 'predicted minus measured [%]')


def _tracking(found: EnergyFigures) -> Html:
    traces = [
        {'type': 'box', 'y': np.round(found.column(shape, 'rms'), 3).tolist(), 'name': shape}
        for shape in found.by_shape
    ]
    return figure('tracking', traces, '', 'RMS error of a move [mrad]')


def _points(name: str, x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    places = {'x': np.round(x, 3).tolist(), 'y': np.round(y, 3).tolist()}
    return {'type': 'scatter', 'mode': 'markers', 'name': name, **places}
