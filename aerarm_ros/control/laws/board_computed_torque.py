"""Computed torque with the proportional and derivative terms on the boards."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.compensation.error_integral import ErrorIntegral
from aerarm_ros.control.compensation.friction_compensation import FrictionCompensation
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.joint_reference import JointReference

Array = npt.NDArray[np.float64]


class BoardComputedTorque:
    """Inverse dynamics as feed-forward to the boards' law, thesis (2.18) and (4.4).

    The boards add `Kp (qd - q) + Kd (dqd - dq)` at 40 kHz, so the feedback sees neither the
    host's cycle nor its delay; in exchange the gains are torques per error, not shaped by
    B(q), and errors of the joints stay coupled.

    Parameters
    ----------
    dynamics : MovingBaseDynamics
    integral : ErrorIntegral, optional
        Its gain is in [1/s^3], its limit in [rad/s^2]: it acts through B(q).
    friction : FrictionCompensation, optional
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        integral: ErrorIntegral | None = None,
        friction: FrictionCompensation | None = None,
    ) -> None:
        self._dynamics = dynamics
        self._integral = integral
        self._friction = friction

    def take_over(self, q: Array) -> None:
        """Start at the present posture, without integral."""
        if self._integral is not None:
            self._integral.reset()

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
        u = self._dynamics.inverse(reference.q, reference.dq, a, base)
        if self._friction is not None:
            load = u - self._dynamics.fixed.rotor_inertia * a
            u = u + self._friction.torque(reference.dq, load)
        return JointCommand(reference.q, reference.dq, u)
