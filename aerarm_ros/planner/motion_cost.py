"""What a spline costs, with its gradient."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.planner.cost_term import CostTerm
from aerarm_ros.planner.spline_basis import SplineBasis


class MotionCost:
    """The sum of some terms, as a function of a spline's free points and maybe its duration.

    Parameters
    ----------
    basis : SplineBasis
    start, end : (n,) ndarray
        Postures at rest [rad].
    terms : sequence of CostTerm
    second : float
        What a second costs, where the duration is free.
    """

    def __init__(
        self,
        basis: SplineBasis,
        start: FloatArray,
        end: FloatArray,
        terms: Sequence[CostTerm],
        second: float = 0.0,
    ) -> None:
        self._basis = basis
        self._ends = start, end
        self._terms = terms
        self._second = second

    def of(self, points: FloatArray, duration: float) -> tuple[float, FloatArray, float]:
        """Return the cost, and its derivatives by points (K, n) and by the logarithm of duration.

        Parameters
        ----------
        points : (K, n) ndarray
            [rad]
        duration : float
            [s]
        """
        motion = self._basis.motion(points, *self._ends, duration)
        dt = duration / self._basis.samples
        parts = [term(motion, dt) for term in self._terms]
        value = sum(part.value for part in parts)
        # Slower by a part in a thousand: so much longer, all velocities so much less, and
        # accelerations twice that.
        by_log = self._second * duration + value
        by_points = np.zeros_like(points)
        rows = ([getattr(part, name) for part in parts] for name in ('by_q', 'by_dq', 'by_ddq'))
        for order, (slopes, matrix) in enumerate(zip(rows, self._basis.matrices, strict=True)):
            slope = np.sum(slopes, axis=0)
            by_points += matrix.T @ slope * duration**-order
            by_log -= order * float((slope * motion[order]).sum())
        return self._second * duration + value, by_points, by_log
