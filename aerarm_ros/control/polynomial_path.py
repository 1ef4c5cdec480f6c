"""Piecewise polynomial joint motion."""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.joint_reference import JointReference

Array = npt.NDArray[np.float64]

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
# Values and slopes at both ends -> the same, of degree 3.
_CUBIC_HERMITE = np.zeros((6, 4))
_CUBIC_HERMITE[:4] = np.linalg.inv([[1, 0, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 1, 2, 3]])


@dataclass(frozen=True, eq=False)
class PolynomialPath:
    """Polynomials of degree five at most, one after the other; the ends hold.

    Attributes
    ----------
    times : (S + 1,) tuple of float
        Boundaries of the S segments [s], rising from 0.
    coefficients : (S, 6, n) ndarray
        Of the powers of x = (t - t_s) / (t_s+1 - t_s) [rad].
    """

    times: tuple[float, ...]
    coefficients: Array

    @classmethod
    def quintic(cls, times: npt.ArrayLike, q: Array, dq: Array, ddq: Array) -> 'PolynomialPath':
        """Return the path through positions, velocities and accelerations (S + 1, n)."""
        t, h = _durations(times)
        ends = [q[:-1], h * dq[:-1], h**2 * ddq[:-1], q[1:], h * dq[1:], h**2 * ddq[1:]]
        return cls(t, np.einsum('ij,jsn->sin', _QUINTIC_HERMITE, np.array(ends)))

    @classmethod
    def cubic(cls, times: npt.ArrayLike, q: Array, dq: Array) -> 'PolynomialPath':
        """Return the path through positions and velocities (S + 1, n)."""
        t, h = _durations(times)
        ends = [q[:-1], h * dq[:-1], q[1:], h * dq[1:]]
        return cls(t, np.einsum('ij,jsn->sin', _CUBIC_HERMITE, np.array(ends)))

    @classmethod
    def rest_to_rest(cls, start: Array, end: Array, duration: float) -> 'PolynomialPath':
        """Return the quintic from rest at `start` (n,) to rest at `end` (n,) [rad]."""
        zero = np.zeros((2, len(start)))
        return cls.quintic((0.0, duration), np.array([start, end]), zero, zero)

    @property
    def duration(self) -> float:
        """Length [s]."""
        return self.times[-1]

    def evaluate(self, time: float) -> JointReference:
        """Return the reference at `time` [s]; before and after, the ends with zero velocity."""
        times = self.times
        if time >= times[-1]:
            return JointReference.at_rest(self.coefficients[-1].sum(axis=0))
        if time < 0.0:
            return JointReference.at_rest(self.coefficients[0, 0])
        segment = bisect_right(times, time) - 1
        h = times[segment + 1] - times[segment]
        powers = _powers((time - times[segment]) / h, h)
        return JointReference(*(powers @ self.coefficients[segment]))

    def sample(self, per_segment: int = 20) -> JointReference:
        """Return references (S * per_segment, n) spread over all segments, ends included."""
        h = np.diff(self.times)
        powers = np.array(
            [[_powers(x, length) for x in np.linspace(0.0, 1.0, per_segment)] for length in h]
        )
        values = np.einsum('spdk,skn->dspn', powers, self.coefficients)
        return JointReference(*values.reshape(3, len(h) * per_segment, -1))


def _durations(times: npt.ArrayLike) -> tuple[tuple[float, ...], Array]:
    t = np.asarray(times, dtype=float)
    return tuple(map(float, t)), np.diff(t)[:, np.newaxis]


def _powers(x: float, h: float) -> Array:
    """Return the powers of x and their first two time derivatives, (3, 6)."""
    x2 = x * x
    x3 = x2 * x
    x4 = x2 * x2
    u = 1.0 / h
    w = u * u
    return np.array(
        [
            [1.0, x, x2, x3, x4, x4 * x],
            [0.0, u, 2.0 * u * x, 3.0 * u * x2, 4.0 * u * x3, 5.0 * u * x4],
            [0.0, 0.0, 2.0 * w, 6.0 * w * x, 12.0 * w * x2, 20.0 * w * x3],
        ]
    )
