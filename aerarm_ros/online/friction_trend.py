"""How friction changes over days and weeks of use."""

from bisect import insort
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.online.online_estimate import FRICTION_NAMES

Array = npt.NDArray[np.float64]

MOST = 500
"""Records that are kept."""
WEEK = 7 * 86400.0
"""[s]"""
_CLEAR = 3.0  # standard deviations


class FrictionRecord(NamedTuple):
    """Friction as it was found at a time.

    Attributes
    ----------
    time : float
        Since 1970 [s].
    friction, std : (3, n) ndarray
        As in `OnlineEstimate`.
    """

    time: float
    friction: Array
    std: Array


@dataclass(frozen=True)
class FrictionChange:
    """What became of one coefficient.

    Attributes
    ----------
    name : str
        Such as 'Coulomb [Nm] of joint2'.
    old, new : float
        At the first and at the last record, on the line that fits all of them best.
    deviations : float
        Of the slope of that line from zero, in standard deviations.
    rate, rate_std : float
        Slope and its standard deviation [a week].
    """

    name: str
    old: float
    new: float
    deviations: float
    rate: float
    rate_std: float

    @property
    def is_clear(self) -> bool:
        """Whether it is more than uncertainty explains."""
        return abs(self.deviations) > _CLEAR


class FrictionTrend:
    """Records of friction, oldest first.

    When there are too many, every second one of the older half goes: the first and the newest
    stay, and long ago is kept as coarsely as it needs.

    Parameters
    ----------
    joint_names : sequence of str
        n joints.
    records : iterable of FrictionRecord, optional
        From earlier days.
    """

    def __init__(self, joint_names: Sequence[str], records: Iterable[FrictionRecord] = ()) -> None:
        self.joint_names = tuple(joint_names)
        self._records = sorted(records, key=lambda record: record.time)
        self._thin()

    @property
    def records(self) -> tuple[FrictionRecord, ...]:
        """All records, oldest first."""
        return tuple(self._records)

    def add(self, record: FrictionRecord) -> None:
        """Take a record, of whatever time: clocks may have been wrong."""
        insort(self._records, record, key=lambda one: one.time)
        self._thin()

    def changes(self) -> list[FrictionChange]:
        """Return what became of each coefficient; nothing before there are two records."""
        if len(self._records) < 2 or self._records[0].time == self._records[-1].time:
            return []
        time = np.array([record.time for record in self._records])
        friction = np.array([record.friction for record in self._records])
        std = np.array([record.std for record in self._records])
        return [
            _change(f'{kind} of {joint}', time, friction[:, row, column], std[:, row, column])
            for row, kind in enumerate(FRICTION_NAMES)
            for column, joint in enumerate(self.joint_names)
        ]

    def _thin(self) -> None:
        while len(self._records) > MOST:
            half = len(self._records) // 2
            self._records[1:half] = self._records[2:half:2]


def _change(name: str, time: Array, value: Array, std: Array) -> FrictionChange:
    """Fit a line by weighted least squares."""
    weight = 1.0 / std**2
    centre = float(weight @ time / weight.sum())
    since = (time - centre) / WEEK
    moment = float(weight @ since**2)
    mean = float(weight @ value / weight.sum())
    rate = float(weight @ (since * (value - mean)) / moment)
    left = value - mean - rate * since
    # Where records scatter by more than they say, as with the temperature, that counts.
    scatter = float(weight @ left**2) / max(len(time) - 2, 1)
    rate_std = float(np.sqrt(max(scatter, 1.0) / moment))
    old, new = (mean + rate * float(since[index]) for index in (0, -1))
    return FrictionChange(name, old, new, rate / rate_std, rate, rate_std)
