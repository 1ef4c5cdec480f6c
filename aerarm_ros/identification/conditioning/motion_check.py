"""Options that describe a recorded motion, its periods, and checks of the options.

Thesis sections 3.4 and 3.5 describe the search for whole periods.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.identification.conditioning.uniform_motion import UniformMotion


@dataclass(frozen=True)
class ConditioningOptions:
    """Conditioning settings of the user; None means that the data determine the setting.

    Attributes
    ----------
    fundamental : float or None
        Fundamental frequency f0 of the excitation [Hz].
    cutoff : float or None
        Cut-off of the torque's low-pass filter [Hz].
    """

    fundamental: float | None = None
    cutoff: float | None = None

    def __post_init__(self) -> None:
        """Validate the settings."""
        for name in ('fundamental', 'cutoff'):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise IdentificationError(f'{name} = {value} must be a positive frequency [Hz]')


# [s] one period of the excitation in thesis section 3.4; shorter motions cause a warning
_SHORT = 10.0
_TOLERANCE = 0.01  # tolerated relative error of a period
# Smallest fraction of a motion in whole periods, because a sweep also repeats locally.
_LARGEST_PART = 0.5
_TOO_SHORT = 3.0  # [s] shortest motion that can be identified


def short_motion_warnings(motion: UniformMotion) -> list[str]:
    """Return warnings about recordings with a short motion that is not periodic."""
    duration = motion.count * motion.dt
    if motion.period is not None or duration >= _SHORT:
        return []
    return [
        f'{motion.recording.name} contains only {duration:.1f} s of motion without repetition: '
        f'record at least one whole period of an excitation, {_SHORT:g} s or more (two periods '
        'are '
        'better)'
    ]


def fundamental_warnings(motion: UniformMotion, fundamental: float) -> list[str]:
    """Return warnings if a given fundamental frequency differs from the motion's period.

    Parameters
    ----------
    motion : UniformMotion
        Motion whose window was chosen by this fundamental frequency.
    fundamental : float
        Fundamental frequency f0 [Hz].

    Raises
    ------
    IdentificationError
        If the frequency is so high that almost no motion is left.
    """
    recording = motion.recording
    if motion.period is None:
        return [
            f'{recording.name} contains less than one period of {1.0 / fundamental:.4g} s, so '
            f'--fundamental {fundamental:g} is ignored: check the option, or record whole periods'
        ]
    found = find_periodic_part(recording.time, recording.q)
    if found is None:
        if _share_of_way(motion) >= _LARGEST_PART:
            return []
        shown = f'does not repeat every {1.0 / fundamental:.4g} s'
    else:
        # Several consecutive periods are periodic as well.
        ratio = 1.0 / (fundamental * found.period)
        if round(ratio) >= 1 and abs(ratio / round(ratio) - 1.0) < _TOLERANCE:
            return []
        shown = f'repeats every {found.period:.4g} s ({found.fundamental:.4g} Hz)'
    text = (
        f'--fundamental is {fundamental:g} Hz, but the motion of {recording.name} {shown}: check '
        'the option, or omit it'
    )
    if motion.count * motion.dt < _TOO_SHORT:
        raise IdentificationError(text)
    return [text]


def _share_of_way(motion: UniformMotion) -> float:
    """Return the fraction of the joints' travel that lies in the window used for identification."""
    way = np.abs(np.diff(motion.q, axis=0)).sum(axis=1)
    return float(way[motion.window].sum() / way.sum())


_RATE = 10.0  # [Hz] sampling rate of the search
_LONGEST = 240.0  # [s] longest part of the motion that is searched
_SHORTEST_PERIOD = 1.0  # [s]
# Largest mean squared difference of two periods, relative to their variance. It is small in a
# repeated motion, which differs only by tracking errors, and about as large as the variance in
# other motions.
_REPEATED = 0.01
# The motion within a period is at least this fraction of the largest motion within any section of
# equal length.
_LEAST_MOTION = 0.2
# Harmonics above this fraction of the largest (in velocity) belong to the excitation.
_HARMONIC_SHARE = 0.03
_MOST_HARMONICS = 50


@dataclass(frozen=True)
class PeriodicPart:
    """Section of a recording that consists of whole periods.

    Attributes
    ----------
    start : float
        Start time [s].
    period : float
        Period 1 / f0 [s].
    periods : int
        Number of periods.
    """

    start: float
    period: float
    periods: int

    @property
    def fundamental(self) -> float:
        """Fundamental frequency f0 [Hz]."""
        return 1.0 / self.period


def find_periodic_part(
    time: Array, q: Array, fundamental: float | None = None
) -> PeriodicPart | None:
    """Find the longest section in which a motion repeats itself.

    The section excludes run-in, run-out and standstill at the ends.

    Parameters
    ----------
    time : (M,) ndarray
        Time [s], increasing.
    q : (M, n) ndarray
        Joint positions [rad].
    fundamental : float, optional
        Fundamental frequency f0 [Hz] if known; otherwise it is estimated from at least two periods.

    Returns
    -------
    PeriodicPart or None
        None if the motion is not periodic, or shorter than one period of `fundamental`.
    """
    # A recording of whole periods ends one sample before the first position recurs.
    end = time[-1] + float(np.median(np.diff(time)))
    coarse_time = np.arange(time[0], min(end, time[0] + _LONGEST) - 1e-6, 1.0 / _RATE)
    coarse = np.column_stack([np.interp(coarse_time, time, column) for column in q.T])
    if fundamental is None:
        lag = _shortest_repeating_lag(coarse)
        if lag is None:
            return None
        period = _refined_period(time, q, coarse_time, coarse, lag)
    else:
        period = 1.0 / fundamental
    part = _place(time, q, period)
    if part is None or fundamental is not None:
        return part
    long_enough = part.periods * part.period >= _LARGEST_PART * _moving_time(coarse)
    return part if long_enough else None


def count_harmonics(dq: Array, periods: int) -> int:
    """Return the highest harmonic N with a significant amplitude in a joint velocity.

    Parameters
    ----------
    dq : (M, n) ndarray
        Joint velocities over whole periods [rad/s].
    periods : int
        Number of periods.
    """
    spectrum = np.abs(np.fft.rfft(dq, axis=0)[periods::periods])[:_MOST_HARMONICS]
    strength = np.sqrt((spectrum**2).sum(axis=1))
    return int(np.flatnonzero(strength > _HARMONIC_SHARE * strength.max())[-1]) + 1


def _mismatch(q: Array, lag: int) -> Array:
    """Return the mismatch of two consecutive sections of `lag` samples, for each start sample.

    The mismatch is the mean squared difference of two consecutive sections of this length, divided
    by twice their common variance. The mismatch is 0 for a repeated motion and about 1 for
    unrelated sections. A smooth motion with a short lag does not have a small mismatch. Sections
    with little motion have an infinite mismatch.
    """
    difference = np.concatenate(([0.0], np.cumsum(((q[lag:] - q[:-lag]) ** 2).sum(axis=1))))
    numerator = difference[lag:] - difference[:-lag]
    variance = _moving_variance(q, 2 * lag)
    steps = np.concatenate(([0.0], np.cumsum((np.diff(q, axis=0) ** 2).sum(axis=1))))
    travel = steps[2 * lag - 1 :] - steps[: -2 * lag + 1]
    moving = (travel > _LEAST_MOTION * travel.max()) & (variance > 0.0)
    return np.where(moving, numerator / (2.0 * lag * np.where(moving, variance, 1.0)), np.inf)


def _shortest_repeating_lag(q: Array) -> int | None:
    shortest, longest = round(_SHORTEST_PERIOD * _RATE), len(q) // 2 + 1
    found: tuple[float, int] | None = None
    for lag in range(shortest, longest):
        worst = float(_mismatch(q, lag).min())
        if found and worst > found[0]:
            return found[1]
        if worst < _REPEATED:
            found = (worst, lag)
    # A mismatch that still falls at the longest lag does not show a minimum.
    return found[1] if found else None


def _refined_period(time: Array, q: Array, coarse_time: Array, coarse: Array, lag: int) -> float:
    """Return the period [s] more accurately than the search for whole samples."""
    start = coarse_time[int(np.argmin(_mismatch(coarse, lag)))]
    length = lag / _RATE
    instants = np.arange(start, start + length, 0.1 / _RATE)
    reference = _at(instants, time, q)
    slope = (_at(instants + 5e-3, time, q) - _at(instants - 5e-3, time, q)) / 1e-2
    period = length
    for _ in range(4):
        # Gauss-Newton on the sum of squared differences between the two periods.
        error = _at(instants + period, time, q) - reference
        period -= float((error * slope).sum() / (slope**2).sum())
    return _rounded(float(np.clip(period, length - 2.0 / _RATE, length + 2.0 / _RATE)))


def _rounded(period: float) -> float:
    """Return the period of the nearest round frequency if it differs by less than 0.1 %."""
    frequency = 1.0 / period
    for digits in (2, 3):
        round_frequency = float(f'{frequency:.{digits}g}')
        if abs(round_frequency - frequency) < 1e-3 * frequency:
            return 1.0 / round_frequency
    return period


def _at(instants: Array, time: Array, q: Array) -> Array:
    return np.column_stack([np.interp(instants, time, column) for column in q.T])


def _place(time: Array, q: Array, period: float) -> PeriodicPart | None:
    """Return the section with the most whole periods; among equals, the best repetition."""
    lag = max(200, round(period * _RATE))
    step = period / lag
    length = time[-1] - time[0] + float(np.median(np.diff(time)))
    count = int(length / step + 1e-6) + 1
    if count <= lag + lag // 20:
        return None
    motion = _at(time[0] + step * np.arange(count), time, q)
    difference = ((motion[lag:] - motion[:-lag]) ** 2).sum(axis=1)
    spread = _moving_variance(motion, lag)[:-1]
    # A standstill repeats itself as well, so a period must contain motion.
    moves = spread > _LEAST_MOTION * spread.max()
    repeats = (difference < 4.0 * _REPEATED * spread.max()) & moves
    periods = min((_longest_run(repeats) + lag + 1) // lag, (count - 1) // lag)
    compared = max((periods - 1) * lag, lag // 20)
    starts = np.arange(count - max(periods * lag, lag + compared))
    total = np.concatenate(([0.0], np.cumsum(difference)))
    mismatch = np.where(moves[starts], total[starts + compared] - total[starts], np.inf)
    # Of equally good sections the middle one is farthest from run-in and run-out.
    negligible = 1e-6 * compared * spread.max()
    good = np.flatnonzero(mismatch <= 1.2 * mismatch.min() + negligible)
    start = time[0] + step * good[(len(good) - 1) // 2]
    return PeriodicPart(float(start), period, max(periods, 1))


def _moving_time(q: Array) -> float:
    """Return the total time [s] of the arm's motion, from positions sampled at the rate `_RATE`."""
    travel = np.linalg.norm(np.diff(q, axis=0), axis=1)
    return float(np.sum(travel > 0.02 * travel.max())) / _RATE


def _moving_variance(q: Array, window: int) -> Array:
    """Return the variance of every section of `window` samples, summed over the joints."""
    centred = q - q.mean(axis=0)
    first = np.concatenate((np.zeros((1, q.shape[1])), np.cumsum(centred, axis=0)))
    second = np.concatenate(([0.0], np.cumsum((centred**2).sum(axis=1))))
    mean = (first[window:] - first[:-window]) / window
    variance = (second[window:] - second[:-window]) / window - (mean**2).sum(axis=1)
    return np.asarray(variance)


def _longest_run(flags: npt.NDArray[np.bool_]) -> int:
    """Return the length of the longest run of True in `flags`."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return int((edges[1::2] - edges[::2]).max()) if len(edges) else 0
