"""Trend of the joints' friction over days and weeks of use."""

from bisect import insort
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.description.resources import write_whole
from aerarm_ros.identification.assessment import weighted_line
from aerarm_ros.identification.joint_model import JointTerm, TermKind
from aerarm_ros.motion.signals import Array
from aerarm_ros.online.payload_estimator import FRICTION_NAMES
from aerarm_ros.online.replay import KnownArm

_WIDTH = 0.01  # [rad/s] over which dry friction changes its direction
_TINY = np.asarray(1e-9)  # [rad/s], so that a velocity of 0 has a sign
_CREEPING = 0.02  # [rad/s] at which the slowly rising part of friction counts as dry


class JointFriction(FrictionCompensation):
    """Joint friction with all identified terms, as a function of the measured velocity.

    It adds the terms that `FrictionCompensation` leaves out: saturating viscous friction,
    Stribeck friction, offsets, one-sided and coupled friction.

    Parameters
    ----------
    arm : KnownArm
    width : float
        Velocity over which dry friction changes its direction [rad/s].
    fraction : float
        Part of the friction that is compensated, 0 to 1.
    """

    def __init__(self, arm: KnownArm, width: float = _WIDTH, fraction: float = 1.0) -> None:
        viscous, coulomb, load = arm.friction
        super().__init__(viscous, coulomb, width, fraction, load)
        self._width = width
        self._dry, self._share = coulomb.copy(), load
        self._others: list[tuple[int, int, JointTerm, float]] = []
        for joint, term, value in arm.others:
            driver = joint if term.driver is None else term.driver
            smooth = term.smooth or term.kind is TermKind.STRIBECK or term.width > 0.0
            known = term if smooth else replace(term, width=width)
            self._others.append((joint, driver, known, fraction * value))
            if not term.smooth:
                self._dry[joint] += abs(value * float(known.basis(_at_creep, _at_creep, None)))

    def torque(self, dq: Array, load: Array | None = None, measured: Array | None = None) -> Array:
        """Return the friction torque (n,) [Nm] for given velocities and load torques on the links.

        Stribeck friction falls with speed, so that a joint that slips is faster than its reference
        and needs less. With the measured velocity it is compensated in the direction of the
        reference and by the size that it has at that velocity: the falling part is cancelled, and
        a joint whose reference rests is not driven.
        """
        torque = super().torque(dq, load)
        for joint, driver, term, value in self._others:
            speed = dq[driver]
            if term.kind is TermKind.STRIBECK:
                present = abs(speed if measured is None else measured[driver])
                basis = term.basis(present + _TINY, present, None) * np.tanh(speed / self._width)
            else:
                basis = term.basis(speed, speed, None)
            torque[joint] += value * float(basis)
        return torque

    def dry(self, load: Array) -> Array:
        """Return the largest dry friction (n,) [Nm] of joints at rest, for given load torques."""
        return np.asarray(self._dry + self._share * np.abs(load))

    def deficit(self, dq: Array) -> Array:
        """Return the fraction (n,) of dry friction that the smoothed model lacks at low speed."""
        return 1.0 - np.tanh(np.abs(dq) / self._width)


_at_creep = np.asarray(_CREEPING)


MOST = 500
"""Largest number of records."""
WEEK = 7 * 86400.0
"""[s]"""
_CLEAR = 3.0  # standard deviations


class FrictionRecord(NamedTuple):
    """Record of the joint friction that was identified at one time.

    Attributes
    ----------
    time : float
        Time of the identification, since 1970 [s].
    friction, std : (3, n) ndarray
        As in `OnlineEstimate`.
    """

    time: float
    friction: Array
    std: Array


@dataclass(frozen=True)
class FrictionChange:
    """Change of a friction coefficient over all records.

    Attributes
    ----------
    name : str
        Name of the coefficient, such as 'Coulomb [Nm] of joint2'.
    old, new : float
        Values of the best-fit line at the first and at the last record.
    deviations : float
        Slope of that line, in standard deviations.
    rate, rate_std : float
        Slope of that line, and its standard deviation [per week].
    """

    name: str
    old: float
    new: float
    deviations: float
    rate: float
    rate_std: float

    @property
    def is_clear(self) -> bool:
        """Whether the change of the coefficient exceeds three standard deviations."""
        return abs(self.deviations) > _CLEAR


class FrictionTrend:
    """Friction records of an arm, oldest first, at most 500.

    If there are too many, every second record of the older half is deleted. The first and the
    newest records stay, and old records become sparse.

    Parameters
    ----------
    joint_names : sequence of str
        n joints.
    records : iterable of FrictionRecord, optional
        Records of earlier days.
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
        """Add a friction record; its time may be earlier than the time of other records."""
        insort(self._records, record, key=lambda one: one.time)
        self._thin()

    def changes(self) -> list[FrictionChange]:
        """Return the change of each friction coefficient; empty with fewer than two records."""
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
    """Return the change of a coefficient, by a weighted least-squares line through its records."""
    weeks = time / WEEK - time.mean() / WEEK
    mean, rate, rate_std = weighted_line(weeks, value, std)
    old, new = (mean + rate * float(weeks[index]) for index in (0, -1))
    return FrictionChange(name, old, new, rate / rate_std, rate, rate_std)


_KINDS = ('viscous', 'coulomb', 'load')
_LARGEST = 1000 * MOST  # bytes; larger than any trend with the largest number of records


class TrendFileError(ValueError):
    """Error for a file that is not this arm's friction trend; the message states what to check."""


def read_trend(path: Path, joint_names: Sequence[str] | None = None) -> FrictionTrend:
    """Return the friction trend that `write_trend` wrote; an empty trend if no file exists.

    Parameters
    ----------
    path : Path
    joint_names : sequence of str, optional
        Joints of the arm; by default those of the file, which must then exist.

    Raises
    ------
    TrendFileError
        If the file has other content, or belongs to another arm.
    OSError
        If the file cannot be read.
    """
    if joint_names is not None and not path.exists():
        return FrictionTrend(joint_names)
    if path.stat().st_size > _LARGEST:
        raise TrendFileError(f'{path} is too large for a friction history: pass another file')
    lines = path.read_text(errors='replace').splitlines()
    names = _names(lines[0] if lines else '')
    if not names or lines[0] != _header(names):
        raise TrendFileError(
            f'{path} is not a friction history: pass a new file, or the file of earlier records'
        )
    if joint_names is not None and names != tuple(joint_names):
        raise TrendFileError(
            f'{path} belongs to joints {", ".join(names)}, not to {", ".join(joint_names)}: use a '
            'separate file for each arm'
        )
    records = []
    for number, line in enumerate(lines[1:], 2):
        try:
            records.append(_record(line, len(names)))
        except ValueError:
            raise TrendFileError(
                f'line {number} of {path} is not a friction record: remove the line'
            ) from None
    return FrictionTrend(names, records)


def write_trend(path: Path, trend: FrictionTrend) -> None:
    """Write a friction trend to a file; an existing file is replaced atomically."""
    lines = [_header(trend.joint_names)]
    for record in trend.records:
        date = datetime.fromtimestamp(record.time, UTC).isoformat(timespec='seconds')
        values = np.stack([record.friction, record.std]).ravel()
        lines.append(','.join([date, *(f'{value:.6g}' for value in values)]))
    write_whole(path, '\n'.join(lines) + '\n')


def _header(joint_names: Sequence[str]) -> str:
    columns = [f'{kind} {joint}' for kind in _KINDS for joint in joint_names]
    return ','.join(['date', *columns, *(f'std {column}' for column in columns)])


def _names(header: str) -> tuple[str, ...]:
    first = f'{_KINDS[0]} '
    columns = header.split(',')
    return tuple(column.removeprefix(first) for column in columns if column.startswith(first))


def _record(line: str, n: int) -> FrictionRecord:
    date, *columns = line.split(',')
    when = datetime.fromisoformat(date)
    if when.tzinfo is None:
        when = when.replace(tzinfo=UTC)
    values = np.array(columns, dtype=float).reshape(2, 3, n)
    if not np.isfinite(values).all() or not (values[1] > 0.0).all():
        raise ValueError('the numbers are unusable')
    return FrictionRecord(when.timestamp(), values[0], values[1])
