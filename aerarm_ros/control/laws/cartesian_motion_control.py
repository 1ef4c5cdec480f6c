"""Kinematic control of Cartesian motion, thesis 2.5.3."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.checks.gains import non_negative
from aerarm_ros.control.laws.velocity_resolution import VelocityResolution
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.task_reference import TaskReference

Array = npt.NDArray[np.float64]


class CartesianMotionControl:
    """Figure 2.7: feedback by direct kinematics, `dq = J#(q) (dpd + K (pd - k(q)))`.

    Parameters
    ----------
    resolution : VelocityResolution
    gain : (3,) array_like
        K [1/s]: away from singularities the tool's error decays as exp(-K t).

    Raises
    ------
    ValueError
        If a gain is negative or their number isn't 3.
    """

    def __init__(self, resolution: VelocityResolution, gain: npt.ArrayLike) -> None:
        self._resolution = resolution
        self._gain = non_negative('gain', gain, 3)

    def take_over(self, q: Array) -> None:
        """Start at the present posture: there is nothing to remember."""

    def update(
        self,
        state: ArmState,
        reference: TaskReference,
        dt: float,
        base: BaseMotion | None = None,
    ) -> JointCommand:
        """Return the velocity (n,) [rad/s]; `dt` and `base` aren't used."""
        error = reference.p - self._resolution.kinematics.position(state.q)
        velocity = reference.dp + self._gain * error
        return JointCommand(dq=self._resolution.resolve(state.q, velocity))
