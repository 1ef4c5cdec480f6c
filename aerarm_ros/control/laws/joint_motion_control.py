"""Kinematic control of joint motion, thesis 2.5.2."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.checks.gains import non_negative, positive
from aerarm_ros.control.laws.velocity_resolution import VelocityResolution
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.task_reference import TaskReference

Array = npt.NDArray[np.float64]


class JointMotionControl:
    """Figure 2.6: the desired path in joint space, `dq = dqd + K (qd - q)`.

    `qd` is made from the Cartesian path by `dqd = J#(qd) (dpd + drift_gain (pd - k(qd)))`,
    integrated; the second term undoes what integration and damping lose. The measured joints
    enter only through K, so the reference is the same on and off line.

    Parameters
    ----------
    resolution : VelocityResolution
    gain : (n,) array_like
        K [1/s]: the joint error decays as exp(-K t).
    drift_gain : float
        [1/s]

    Attributes
    ----------
    qd : (n,) ndarray
        Present reference of the joints [rad].

    Raises
    ------
    ValueError
        If a gain is negative or their number isn't n.
    """

    def __init__(
        self, resolution: VelocityResolution, gain: npt.ArrayLike, drift_gain: float = 10.0
    ) -> None:
        n = resolution.kinematics.robot.n
        self._resolution = resolution
        self._gain = non_negative('gain', gain, n)
        self._drift_gain = positive('drift_gain', drift_gain)
        self.qd = np.zeros(n)

    def take_over(self, q: Array) -> None:
        """Start the reference at the present posture `q` (n,) [rad]."""
        self.qd = np.array(q)

    def update(
        self,
        state: ArmState,
        reference: TaskReference,
        dt: float,
        base: BaseMotion | None = None,
    ) -> JointCommand:
        """Return the velocity (n,) [rad/s] for this cycle of `dt` [s]; `base` isn't used."""
        error = reference.p - self._resolution.kinematics.position(self.qd)
        dqd = self._resolution.resolve(self.qd, reference.dp + self._drift_gain * error)
        dq = dqd + self._gain * (self.qd - state.q)
        self.qd = self.qd + dt * dqd
        return JointCommand(dq=dq)
