"""How much too near a motion comes to the arm itself, to its base and to the ground."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.excitation.clearance.clearance_checker import ClearanceChecker
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.planner.cost_term import TermValue

_ROOM = 0.01  # [m] beyond the required distance: postures between two instants may be nearer
_SCALE = 0.05  # [m]


class ClearanceTerm:
    """Penalty of distances below what is required.

    Parameters
    ----------
    clearance : ClearanceChecker
    penalty : float
        Of (missing distance / 50 mm)^2 [1/s].
    """

    def __init__(self, clearance: ClearanceChecker, penalty: float) -> None:
        self._clearance = clearance
        self._penalty = penalty / _SCALE**2
        # Postures that were looked at (M, n) [rad], and their margins [m].
        self._seen: tuple[FloatArray, FloatArray] | None = None

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        nothing = np.zeros_like(motion.q)
        by_q, value = nothing.copy(), 0.0
        for k in np.flatnonzero(self._may_be_near(motion.q)).tolist():
            q = motion.q[k]
            missing = _ROOM - self._look(k, q)
            if missing > 0.0:
                value += dt * self._penalty * missing**2
                slope = -2.0 * dt * self._penalty * missing
                by_q[k] = slope * self._clearance.margin_gradient(q)
        return TermValue(value, by_q, nothing, nothing)

    def _may_be_near(self, q: FloatArray) -> npt.NDArray[np.bool_]:
        """Return the rows whose margin is not known to suffice by a posture seen before."""
        if self._seen is None:
            self._seen = np.array(q), np.full(len(q), -np.inf)
        before, margin = self._seen
        nearer = np.abs(q - before) @ self._clearance.steepest
        return np.asarray(margin - nearer < _ROOM)

    def _look(self, k: int, q: FloatArray) -> float:
        assert self._seen is not None
        margin = self._clearance.margin(q)
        self._seen[0][k], self._seen[1][k] = q, margin
        return margin
