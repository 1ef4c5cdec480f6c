"""Energy that planned motions save, and accuracy of the predicted energy."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from energy_moves.energy_bench import SETTLE, Taken
from energy_moves.move import PLANNED, TRAPEZOID

from aerarm_ros.planner.motion_plan import QUINTIC

SAVING, PREDICTED, WITHIN = 0.45, 0.9, 0.1
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
        for other in (QUINTIC, TRAPEZOID):
            saving = 100.0 * self.saving(other)
            low, middle, high = np.percentile(saving, (10, 50, 90)).tolist()
            worse = int((saving < 0.0).sum())
            rows.append((other, middle, float(saving.min()), low, high, worse))
        return rows

    def text(self, standby: float, watt_hours: float) -> str:
        """Return the figures and the goals as text."""
        lines = [
            f'{"":10} {"J a move":>9} {"predicted":>10} {"RMS":>6} {"RMS":>6} {"largest":>8} '
            f'{"battery":>8}'
        ]
        lines.append(
            f'{"":10} {"median":>9} {"within 10%":>10} {"mrad":>6} {"median":>6} {"mrad":>8} '
            f'{"min":>8}'
        )
        for shape, joules, predicted, rms, median, largest, minutes in self.rows(
            standby, watt_hours
        ):
            lines.append(
                f'{shape:10} {joules:9.2f} {predicted:9.0f}% {rms:6.2f} {median:6.2f} '
                f'{largest:8.2f} {minutes:8.0f}'
            )
        count = len(self.by_shape[PLANNED])
        for other, middle, least, low, high, worse in self.savings():
            lines.append(
                f'saving relative to {other} of the same duration: median {middle:.1f} %, '
                f'smallest {least:.1f} %, p10 {low:.1f} %, p90 {high:.1f} %; worse: {worse} of '
                f'{count}'
            )
        return '\n'.join([*lines, GOALS])


def figures(results: list[Taken]) -> EnergyFigures:
    """Return the figures of results in arbitrary order."""
    shapes: dict[str, dict[int, Taken]] = {}
    for one in results:
        shapes.setdefault(one.shape, {})[one.pair] = one
    common = sorted(set.intersection(*(set(rows) for rows in shapes.values())))
    return EnergyFigures({shape: [rows[k] for k in common] for shape, rows in shapes.items()})
