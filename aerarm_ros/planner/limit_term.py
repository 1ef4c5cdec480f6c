"""How far a motion is beyond its limits."""

from typing import NamedTuple

import numpy as np

from aerarm_ros.excitation.settings.motion_limits import MotionLimits
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.planner.cost_term import TermValue

# A penalty gives way a little, and between two instants a motion may be faster than at both.
_BEGIN = 0.97  # share of a limit


class Excess(NamedTuple):
    """A penalty, summed up, and its slope (M, n) by each value."""

    value: float
    slope: FloatArray


def excess(values: FloatArray, limit: FloatArray, penalty: float) -> Excess:
    """Return the penalty of values (M, n) beyond limits (n,), infinite ones being none."""
    beyond = np.maximum(np.abs(values) / limit - _BEGIN, 0.0)
    slope = (2.0 * penalty) * beyond * np.sign(values) / limit
    return Excess(penalty * float((beyond**2).sum()), slope)


class LimitTerm:
    """Penalty of velocities and accelerations beyond their limits.

    Parameters
    ----------
    limits : MotionLimits
    penalty : float
        Of (excess / limit)^2 [1/s].
    """

    def __init__(self, limits: MotionLimits, penalty: float) -> None:
        self._limits = limits
        self._penalty = penalty

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        velocity = excess(motion.dq, self._limits.velocity, self._penalty)
        acceleration = excess(motion.ddq, self._limits.acceleration, self._penalty)
        value = dt * (velocity.value + acceleration.value)
        return TermValue(
            value, np.zeros_like(motion.q), dt * velocity.slope, dt * acceleration.slope
        )
