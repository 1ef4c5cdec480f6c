"""Computed torque with the proportional and derivative terms on the boards."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.laws.inverse_dynamics_law import InverseDynamicsLaw
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.joint_reference import JointReference

Array = npt.NDArray[np.float64]


class BoardComputedTorque(InverseDynamicsLaw):
    """Inverse dynamics as feed-forward to the boards' law, thesis (2.18) and (4.4).

    The boards add `Kp (qd - q) + Kd (dqd - dq)` at 40 kHz, so the feedback sees neither the
    host's cycle nor its delay; in exchange the gains are torques per error, not shaped by
    B(q), and errors of the joints stay coupled. Made of what `InverseDynamicsLaw` is made of.
    """

    def update(
        self,
        state: ArmState,
        reference: JointReference,
        dt: float,
        base: BaseMotion | None = None,
    ) -> JointCommand:
        """Return position [rad], velocity [rad/s] and effort [Nm], each (n,)."""
        a = reference.ddq
        if self._integral is not None:
            a = a + self._integral.update(reference.q - state.q, dt)
        # Nonlinear terms at the reference: measured noise stays out, and the boards' stiff
        # loop keeps the arm close enough to it.
        u = self._torque(reference.q, reference.dq, a, reference, base)
        return JointCommand(reference.q, reference.dq, u)
