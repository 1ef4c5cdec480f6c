"""Limits of a motion as a few smooth constraints for an optimiser."""

from __future__ import annotations

import numpy as np
import scipy

from aerarm_ros.excitation.clearance.clearance_checker import ClearanceChecker
from aerarm_ros.excitation.settings.motion_limits import MotionLimits
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


class DesignConstraints:
    """One constraint for each joint and kind of limit, and one for all clearances.

    The samples of each are joined by the Kreisselmeier-Steinhauser function, a log-sum-exp that
    is never below their largest: what it allows, every sample allows. It only guides the
    optimiser; `FeasibilityChecker` decides.

    Parameters
    ----------
    limits : limits of position, velocity and acceleration.
    effort : (n,) torque limit [Nm], motor current included.
    clearance : distances to keep; None leaves collisions out.
    pad : distance kept beyond the required clearance [m], for what lies between the samples.
    sharpness : of the joining; the largest sample is overestimated by log(M) / sharpness.
    """

    _CLEARANCE_SCALE = 0.1
    """Distance [m] that weighs as much as a whole limit of another kind."""

    def __init__(
        self,
        limits: MotionLimits,
        effort: FloatArray,
        clearance: ClearanceChecker | None,
        pad: float = 0.003,
        sharpness: float = 100.0,
    ) -> None:
        low, high = limits.position_min, limits.position_max
        bounded = np.isfinite(low) & np.isfinite(high)
        self._centre = np.where(bounded, 0.5 * (low + high), 0.0)
        half_range = np.where(bounded, 0.5 * (high - low), np.inf)
        self._scales = (half_range, limits.velocity, limits.acceleration, effort)
        finite = np.isfinite(np.concatenate(self._scales))
        self.active = np.append(finite, [True] * (clearance is not None))
        """Which of the constraints there are: a limit that is infinite is none."""
        self._clearance = clearance
        self._pad = pad
        self._sharpness = sharpness

    def values(self, states: JointReference, effort: FloatArray, period: int) -> FloatArray:
        """Return the constraints, (4 n,) or (4 n + 1,), all >= 0 where feasible.

        Parameters
        ----------
        states : (M, n) states, the period's first.
        effort : (M, n) joint torques [Nm].
        period : number of samples of the period.
        """
        parts = [1.0 - self._join(ratio**2) for ratio in self._ratios(states, effort)]
        if self._clearance is not None:
            shortfall = self._shortfall(states.q[:period])
            parts.append(-np.atleast_1d(self._join(shortfall)))
        return np.concatenate(parts)

    def gradients(
        self, states: JointReference, effort: FloatArray, period: int
    ) -> tuple[list[FloatArray], FloatArray | None]:
        """Return the derivatives of the constraints by the sampled quantities.

        Returns
        -------
        joint : derivatives (M, n) of the n constraints of position, velocity, acceleration and
            torque, each by its own joint's quantity.
        clearance : derivative (M, n) of the last constraint by the positions, or None.
        """
        joint = [
            -2.0 * ratio / scale * scipy.special.softmax(self._sharpness * ratio**2, axis=0)
            for ratio, scale in zip(self._ratios(states, effort), self._scales, strict=True)
        ]
        if self._clearance is None:
            return joint, None
        clearance = np.zeros_like(states.q)
        clearance[:period] = self._clearance_gradient(states.q[:period])
        return joint, clearance

    def _ratios(self, states: JointReference, effort: FloatArray) -> list[FloatArray]:
        quantities = (states.q - self._centre, states.dq, states.ddq, effort)
        return [values / scale for values, scale in zip(quantities, self._scales, strict=True)]

    def _join(self, values: FloatArray) -> FloatArray:
        return np.asarray(
            scipy.special.logsumexp(self._sharpness * values, axis=0) / self._sharpness
        )

    def _shortfall(self, positions: FloatArray) -> FloatArray:
        """Return how far each posture falls short of the clearance, positive beyond, (M,)."""
        assert self._clearance is not None
        margins = np.array([self._clearance.margin(q) for q in positions])
        return (self._pad - margins) / self._CLEARANCE_SCALE

    def _clearance_gradient(self, positions: FloatArray) -> FloatArray:
        assert self._clearance is not None
        weights = scipy.special.softmax(self._sharpness * self._shortfall(positions))
        gradient = np.zeros_like(positions)
        # Postures far from any obstacle have no weight, and these are most of them.
        for sample in np.flatnonzero(weights > 1e-6):
            slope = self._clearance.margin_gradient(positions[sample])
            gradient[sample] = weights[sample] * slope / self._CLEARANCE_SCALE
        return gradient
