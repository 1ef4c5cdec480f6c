"""Rest-to-rest splines that depend linearly on their free control points."""

from functools import lru_cache

import numpy as np
import scipy

from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference

_DEGREE = 5
# number of control points at each end that are fixed, because the motion starts and ends at rest
_AT_REST = 3


class SplineBasis:
    """Quintic B-splines on [0, 1] with uniform knots, at rest at both ends.

    A motion is linear in its (K, n) free control points. A motion lies within the range of the
    control points, start and end, so bounds on the points are bounds on positions.

    Parameters
    ----------
    free : int
        Number K of free control points.
    samples : int
        Number M of uniform intervals; the spline is evaluated at their centres.

    Attributes
    ----------
    matrices : (3, M, K) ndarray
        Matrices that map free points to positions and their first two derivatives by x = t / T.
    """

    def __init__(self, free: int, samples: int) -> None:
        self.free = free
        self.samples = samples
        count = free + 2 * _AT_REST
        spans = count - _DEGREE
        self._breaks = np.linspace(0.0, 1.0, spans + 1)
        ends = np.ones(_DEGREE)
        knots = np.concatenate([0.0 * ends, self._breaks, ends])
        self._spline = scipy.interpolate.BSpline(knots, np.eye(count), _DEGREE)
        # Values of x for the control points: control points on a straight line over these x give
        # this line.
        places = [knots[i + 1 : i + 1 + _DEGREE].mean() for i in range(count)]
        self._places = np.array(places[_AT_REST:-_AT_REST])
        middles = (np.arange(samples) + 0.5) / samples
        self._first, self.matrices, self._last = self._split(middles)
        self._at_breaks = self._split(self._breaks)

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, free: int, samples: int) -> 'SplineBasis':
        """Return the basis of `free` points and `samples` instants, from a cache if possible."""
        return cls(free, samples)

    def points_near(self, motion: PolynomialPath) -> Array:
        """Return the free points (K, n) of a spline that approximates a motion."""
        return motion.evaluate(self._places * motion.duration).q

    def motion(self, points: Array, start: Array, end: Array, duration: float) -> JointReference:
        """Return the motion at the centres of the M time intervals.

        Parameters
        ----------
        points : (K, n) ndarray
            Free control points [rad].
        start, end : (n,) ndarray
            Postures at rest [rad].
        duration : float
            Duration of the motion [s].
        """
        parts = (self._first, self.matrices, self._last)
        return JointReference(*_scaled(parts, points, start, end, duration))

    def path(self, points: Array, start: Array, end: Array, duration: float) -> PolynomialPath:
        """Return the motion of the spline as a polynomial path."""
        q, dq, ddq = _scaled(self._at_breaks, points, start, end, duration)
        q[0], q[-1] = start, end
        dq[[0, -1]] = ddq[[0, -1]] = 0.0
        return PolynomialPath.quintic(self._breaks * duration, q, dq, ddq)

    def _split(self, x: Array) -> tuple[Array, Array, Array]:
        """Return the matrices that map start, free points and end to the spline's values at x."""
        rows = np.array([self._spline.derivative(d)(x) if d else self._spline(x) for d in range(3)])
        first, last = rows[:, :, :_AT_REST].sum(axis=2), rows[:, :, -_AT_REST:].sum(axis=2)
        return first, rows[:, :, _AT_REST:-_AT_REST], last


def _scaled(
    parts: tuple[Array, Array, Array], points: Array, start: Array, end: Array, duration: float
) -> Array:
    """Return position, velocity and acceleration (3, M, n) at M instants of a motion."""
    first, matrices, last = parts
    rate = duration ** -np.arange(3.0)
    by_x = matrices @ points + first[:, :, np.newaxis] * start + last[:, :, np.newaxis] * end
    return np.asarray(rate[:, np.newaxis, np.newaxis] * by_x)
