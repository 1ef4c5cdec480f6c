"""Finding the whole periods in a recorded motion, thesis sections 3.4 and 3.5."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.motion.signals import Array

_RATE = 10.0  # [Hz] the search works on the motion sampled this often
_LONGEST = 240.0  # [s] and looks at no more than this much of it
_SHORTEST_PERIOD = 1.0  # [s]
# Mean squared difference of two periods, as a share of their variance: a repeated motion
# differs by tracking errors, a motion that isn't repeated by its own size.
_REPEATED = 0.01
# A period moves at least this share of what the liveliest stretch does.
_LIVELY = 0.2
# ... and the periods make up this share of the motion: a sweep also has similar neighbours.
_LARGEST_PART = 0.5
# A harmonic belongs to the excitation above this share of the strongest one (velocity).
_HARMONIC_SHARE = 0.03
_MOST_HARMONICS = 50


@dataclass(frozen=True)
class PeriodicPart:
    """The stretch of a recording that consists of whole periods.

    Attributes
    ----------
    start : float
        Time at which it begins [s].
    period : float
        1 / f0 [s].
    periods : int
        How many.
    """

    start: float
    period: float
    periods: int

    @property
    def fundamental(self) -> float:
        """f0 [Hz]."""
        return 1.0 / self.period


def find_periodic_part(
    time: Array, q: Array, fundamental: float | None = None
) -> PeriodicPart | None:
    """Look for the longest stretch in which a motion repeats itself.

    Run-in, run-out and standing still at the ends are left out.

    Parameters
    ----------
    time : (M,) ndarray
        [s], increasing.
    q : (M, n) ndarray
        Joint positions [rad].
    fundamental : float, optional
        f0 [Hz] where it is known; found from the data otherwise, which takes two periods.

    Returns
    -------
    PeriodicPart or None
        None if the motion isn't periodic (or too short for one period of `fundamental`).
    """
    # A recording of whole periods ends one sample before its beginning comes back.
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
    """Return N, the highest harmonic with a substantial share of a velocity.

    Parameters
    ----------
    dq : (M, n) ndarray
        Joint velocities over whole periods [rad/s].
    periods : int
        How many periods these are.
    """
    spectrum = np.abs(np.fft.rfft(dq, axis=0)[periods::periods])[:_MOST_HARMONICS]
    strength = np.sqrt((spectrum**2).sum(axis=1))
    return int(np.flatnonzero(strength > _HARMONIC_SHARE * strength.max())[-1]) + 1


def _mismatch(q: Array, lag: int) -> Array:
    """Return how far the motion is from repeating itself after `lag`, for each start.

    Mean squared difference of two consecutive stretches of this length, over twice the
    variance in both together: 0 for a repeated motion, about 1 for an unrelated one, and
    never small for a smooth motion merely because the lag is short. Infinite where there is
    little motion.
    """
    difference = np.concatenate(([0.0], np.cumsum(((q[lag:] - q[:-lag]) ** 2).sum(axis=1))))
    numerator = difference[lag:] - difference[:-lag]
    variance = _moving_variance(q, 2 * lag)
    steps = np.concatenate(([0.0], np.cumsum((np.diff(q, axis=0) ** 2).sum(axis=1))))
    travel = steps[2 * lag - 1 :] - steps[: -2 * lag + 1]
    lively = (travel > _LIVELY * travel.max()) & (variance > 0.0)
    return np.where(lively, numerator / (2.0 * lag * np.where(lively, variance, 1.0)), np.inf)


def _shortest_repeating_lag(q: Array) -> int | None:
    shortest, longest = round(_SHORTEST_PERIOD * _RATE), len(q) // 2 + 1
    found: tuple[float, int] | None = None
    for lag in range(shortest, longest):
        worst = float(_mismatch(q, lag).min())
        if found and worst > found[0]:
            return found[1]
        if worst < _REPEATED:
            found = (worst, lag)
    # Still falling at the longest lag that can be tested: the valley was not seen to end.
    return found[1] if found else None


def _refined_period(time: Array, q: Array, coarse_time: Array, coarse: Array, lag: int) -> float:
    """Return the period [s], more finely than the search's own steps."""
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
    """Return the period of the round frequency next to it, if that is within measurement."""
    frequency = 1.0 / period
    for digits in (2, 3):
        round_frequency = float(f'{frequency:.{digits}g}')
        if abs(round_frequency - frequency) < 1e-3 * frequency:
            return 1.0 / round_frequency
    return period


def _at(instants: Array, time: Array, q: Array) -> Array:
    return np.column_stack([np.interp(instants, time, column) for column in q.T])


def _place(time: Array, q: Array, period: float) -> PeriodicPart | None:
    """Return where most whole periods fit; of several such places, where they agree best."""
    lag = max(200, round(period * _RATE))
    step = period / lag
    length = time[-1] - time[0] + float(np.median(np.diff(time)))
    count = int(length / step + 1e-6) + 1
    if count <= lag + lag // 20:
        return None
    motion = _at(time[0] + step * np.arange(count), time, q)
    difference = ((motion[lag:] - motion[:-lag]) ** 2).sum(axis=1)
    spread = _moving_variance(motion, lag)[:-1]
    # Standing still repeats itself too, so a period must also move.
    moves = spread > _LIVELY * spread.max()
    repeats = (difference < 4.0 * _REPEATED * spread.max()) & moves
    periods = min((_longest_run(repeats) + lag + 1) // lag, (count - 1) // lag)
    compared = max((periods - 1) * lag, lag // 20)
    starts = np.arange(count - max(periods * lag, lag + compared))
    total = np.concatenate(([0.0], np.cumsum(difference)))
    mismatch = np.where(moves[starts], total[starts + compared] - total[starts], np.inf)
    # The middle of the equally good places is farthest from run-in and run-out.
    negligible = 1e-6 * compared * spread.max()
    good = np.flatnonzero(mismatch <= 1.2 * mismatch.min() + negligible)
    start = time[0] + step * good[(len(good) - 1) // 2]
    return PeriodicPart(float(start), period, max(periods, 1))


def _moving_time(q: Array) -> float:
    """Return how long a motion sampled at the search's rate really moves [s]."""
    travel = np.linalg.norm(np.diff(q, axis=0), axis=1)
    return float(np.sum(travel > 0.02 * travel.max())) / _RATE


def _moving_variance(q: Array, window: int) -> Array:
    """Return the variance, summed over the joints, of each `window` samples."""
    centred = q - q.mean(axis=0)
    first = np.concatenate((np.zeros((1, q.shape[1])), np.cumsum(centred, axis=0)))
    second = np.concatenate(([0.0], np.cumsum((centred**2).sum(axis=1))))
    mean = (first[window:] - first[:-window]) / window
    variance = (second[window:] - second[:-window]) / window - (mean**2).sum(axis=1)
    return np.asarray(variance)


def _longest_run(flags: npt.NDArray[np.bool_]) -> int:
    """Return the length of the longest stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return int((edges[1::2] - edges[::2]).max()) if len(edges) else 0
