"""Joint motion as a piecewise polynomial of time.

Used for run-in and run-out of an excitation, smooth stops, and paths between postures.
"""

from bisect import bisect_right
from dataclasses import dataclass
from math import perm
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerarm_ros.motion.signals import Array, JointReference

PEAK_SLOPE = 1.875
"""Largest slope of `smooth_step`, in its middle."""
PEAK_CURVATURE = 10.0 / np.sqrt(3.0)
"""Largest second derivative of `smooth_step`."""


class SmoothStep(NamedTuple):
    """Value of `smooth_step` at x, slope, integral from 0 to x, and second derivative."""

    value: Array
    slope: Array
    integral: Array
    curvature: Array


def smooth_step(x: ArrayLike) -> SmoothStep:
    """Return the smooth step 10 x^3 - 15 x^4 + 6 x^5, with zero slope and curvature at its ends.

    Outside [0, 1] the value stays at 0 or 1 and the integral at 0 or 1/2; callers add the
    integral of the constant part. `x` is a dimensionless scalar or array.
    """
    # Not np.clip, which would dominate the time of this 1 kHz call.
    u: Array = np.minimum(np.maximum(x, 0.0), 1.0)
    return SmoothStep(
        u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
        30.0 * u**2 * (1.0 - u) ** 2,
        u**4 * (2.5 - 3.0 * u + u**2),
        60.0 * u * (1.0 - u) * (1.0 - 2.0 * u),
    )


def rest_to_rest_duration(
    distance: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, minimum: float
) -> float:
    """Return the shortest duration [s] of a quintic rest-to-rest motion within limits.

    Parameters
    ----------
    distance : (n,) signed joint travel [rad].
    velocity, acceleration : (n,) positive limits of the largest velocity [rad/s] and acceleration
        [rad/s^2].
    minimum : lower bound of the duration [s].
    """
    travel = np.abs(np.asarray(distance, dtype=float))
    by_velocity = PEAK_SLOPE * travel / np.asarray(velocity, dtype=float)
    by_acceleration = np.sqrt(PEAK_CURVATURE * travel / np.asarray(acceleration, dtype=float))
    return float(max(minimum, by_velocity.max(), by_acceleration.max()))


# Implemented here rather than with scipy.interpolate.BPoly, because paths are evaluated in 1 ms
# cycles, and a stream of single points creates one path per cycle. SciPy takes 64 us to create a
# path and 13 us to evaluate it with both derivatives; this class takes 15 us and 4 us.


# Values, slopes and curvatures at both ends of x = 0 .. 1 -> coefficients of 1, x, .. x^5.
_QUINTIC_HERMITE = np.linalg.inv(
    [
        [1, 0, 0, 0, 0, 0],
        [0, 1, 0, 0, 0, 0],
        [0, 0, 2, 0, 0, 0],
        [1, 1, 1, 1, 1, 1],
        [0, 1, 2, 3, 4, 5],
        [0, 0, 2, 6, 12, 20],
    ]
)
# Order of a derivative in x -> factors of the remaining coefficients.
_FACTORS = {
    order: np.array([perm(power, order) for power in range(order, 6)], dtype=float)
    for order in (1, 2, 3)
}


@dataclass(frozen=True, eq=False)
class PolynomialPath:
    """Path as a piecewise polynomial of degree five or less, constant outside its duration.

    Attributes
    ----------
    times : (S + 1,) tuple of float
        Boundaries of the S segments [s], increasing from 0.
    coefficients : (S, 6, n) ndarray
        Coefficients of the powers of x = (t - t_s) / (t_s+1 - t_s) [rad].
    """

    times: tuple[float, ...]
    coefficients: Array

    @classmethod
    def quintic(cls, times: ArrayLike, q: Array, dq: Array, ddq: Array) -> 'PolynomialPath':
        """Return the path through given positions, velocities, accelerations, (S + 1, n) each."""
        t, h = _durations(times)
        ends = [q[:-1], h * dq[:-1], h**2 * ddq[:-1], q[1:], h * dq[1:], h**2 * ddq[1:]]
        return cls(t, np.einsum('ij,jsn->sin', _QUINTIC_HERMITE, np.array(ends)))

    @classmethod
    def rest_to_rest(cls, start: Array, end: Array, duration: float) -> 'PolynomialPath':
        """Return the quintic from rest at `start` (n,) to rest at `end` (n,) [rad]."""
        zero = np.zeros((2, len(start)))
        return cls.quintic((0.0, duration), np.array([start, end]), zero, zero)

    @property
    def duration(self) -> float:
        """Duration of the path [s]."""
        return self.times[-1]

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], a scalar or (M,).

        Before the start and after the end, the reference is at rest at the first or last posture.
        """
        if isinstance(time, float):
            return self._evaluate_one(time)
        times = np.asarray(time, dtype=float)
        return self._evaluate_many(times) if times.ndim else self._evaluate_one(float(times))

    def sample(self, per_segment: int = 20) -> JointReference:
        """Return references (S * per_segment, n), evenly spread over each segment."""
        h = np.diff(self.times)[:, np.newaxis]
        x = np.linspace(0.0, 1.0, per_segment)[np.newaxis, :]
        values = np.einsum('dksp,skn->dspn', _powers(x + 0.0 * h, h), self.coefficients)
        return JointReference(*values.reshape(3, h.size * per_segment, -1))

    def extremes(self) -> JointReference:
        """Return the references (M, n) where position, velocity or acceleration is extreme.

        Extremes at the ends of segments, which `sample` contains, are excluded. The computation
        takes about 20 times as long as `sample`.
        """
        h = np.diff(self.times)
        found = [self._extremes(np.linspace(0.0, 1.0, 20), order) for order in (1, 2, 3)]
        segments, places = (np.concatenate(parts) for parts in zip(*found, strict=True))
        powers = _powers(places, h[segments])
        return JointReference(*np.einsum('dkm,mkn->dmn', powers, self.coefficients[segments]))

    def _extremes(self, x: Array, order: int) -> tuple[NDArray[np.intp], Array]:
        """Return the zeros of a derivative: segment number and position in the segment of each."""
        derived = self.coefficients[:, order:] * _FACTORS[order][:, np.newaxis]
        values = np.einsum('px,sxn->spn', x[:, np.newaxis] ** np.arange(6 - order), derived)
        segment, before, joint = np.nonzero(values[:, :-1] * values[:, 1:] < 0.0)
        first, second = values[segment, before, joint], values[segment, before + 1, joint]
        low, high = x[before], x[before + 1]
        place = low + (high - low) * first / (first - second)
        polynomial = derived[segment, :, joint]
        # Newton steps, which reduce the error of the sampled zero to rounding errors
        for _ in range(3):
            powers = place[:, np.newaxis] ** np.arange(6 - order)
            value = (powers * polynomial).sum(axis=1)
            slope = (powers[:, :-1] * polynomial[:, 1:] * np.arange(1, 6 - order)).sum(axis=1)
            step = np.divide(value, slope, out=np.zeros_like(value), where=slope != 0.0)
            place = np.minimum(np.maximum(place - step, low), high)
        return segment, place

    def _evaluate_one(self, time: float) -> JointReference:
        times = self.times
        if time >= times[-1]:
            return JointReference.at_rest(self.coefficients[-1].sum(axis=0))
        if time < 0.0:
            return JointReference.at_rest(self.coefficients[0, 0])
        segment = bisect_right(times, time) - 1
        h = times[segment + 1] - times[segment]
        powers = _powers((time - times[segment]) / h, h)
        return JointReference(*(powers @ self.coefficients[segment]))

    def _evaluate_many(self, time: Array) -> JointReference:
        times = np.array(self.times)
        segment = np.searchsorted(times, time, side='right') - 1
        segment = np.minimum(np.maximum(segment, 0), len(times) - 2)
        h = np.diff(times)[segment]
        x = np.minimum(np.maximum((time - times[segment]) / h, 0.0), 1.0)
        powers = _powers(x, h)
        powers[1:, :, (time < 0.0) | (time >= times[-1])] = 0.0
        return JointReference(*np.einsum('dkm,mkn->dmn', powers, self.coefficients[segment]))


def _durations(times: ArrayLike) -> tuple[tuple[float, ...], Array]:
    t = np.asarray(times, dtype=float)
    return tuple(map(float, t)), np.diff(t)[:, np.newaxis]


def _powers(x: Any, h: Any) -> Array:
    """Return the powers x^0 to x^5 and their first two time derivatives, (3, 6, ...).

    `x` and `h` [s] are numbers or arrays; NumPy functions would dominate the time.
    """
    zero = 0.0 * x
    one = zero + 1.0
    x2 = x * x
    x3 = x2 * x
    x4 = x2 * x2
    u = one / h
    w = u * u
    return np.array(
        [
            [one, x, x2, x3, x4, x4 * x],
            [zero, u, 2.0 * u * x, 3.0 * u * x2, 4.0 * u * x3, 5.0 * u * x4],
            [zero, zero, 2.0 * w, 6.0 * w * x, 12.0 * w * x2, 20.0 * w * x3],
        ]
    )
