"""Trajectory tracking by computed torque, thesis 2.6.2, with the loop closed on the host."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks.gains import non_negative
from aerarm_ros.control.compensation.error_integral import ErrorIntegral
from aerarm_ros.control.compensation.friction_compensation import FrictionCompensation
from aerarm_ros.control.laws.inverse_dynamics_law import InverseDynamicsLaw
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.joint_reference import JointReference

Array = npt.NDArray[np.float64]


class ComputedTorque(InverseDynamicsLaw):
    """Thesis (2.21): `u = B(q) a + n(q, dq)`, `a = ddqd + Kp (qd - q) + Kd (dqd - dq)`.

    The error obeys (2.22), `dde + Kd de + Kp e = 0`, in every joint and posture. An integral
    of the error can be added to `a` (the PID of thesis 2.6.2), and friction is compensated
    along the reference velocity.

    That holds for a torque that acts at once and a velocity that is the present one. With `delay`
    and `velocity_lag` the model is asked for the torque that is due when it acts, but for the
    change of the acceleration until then, and measured velocities are led on by what the filter
    holds back. Only the reference is looked ahead on: the loop stays what it is.

    Parameters
    ----------
    dynamics : MovingBaseDynamics
    kp : (n,) array_like
        [1/s^2]
    kd : (n,) array_like
        [1/s]; `2 sqrt(kp)` damps critically.
    integral : ErrorIntegral, optional
        Its gain is in [1/s^3], its limit in [rad/s^2].
    friction : FrictionCompensation, optional
    delay : float
        From a state to the middle of the time in which its command acts [s].
    velocity_lag : float
        Time constant of the low-pass that measured velocities come through [s].

    Attributes
    ----------
    kp, kd : (n,) ndarray
        May be replaced at any time.

    Raises
    ------
    ValueError
        If a gain is negative or their number isn't n.
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        kp: npt.ArrayLike,
        kd: npt.ArrayLike,
        integral: ErrorIntegral | None = None,
        friction: FrictionCompensation | None = None,
        delay: float = 0.0,
        velocity_lag: float = 0.0,
    ) -> None:
        super().__init__(dynamics, integral, friction)
        self.kp = non_negative('kp', kp, dynamics.n)
        self.kd = non_negative('kd', kd, dynamics.n)
        self._delay = delay
        self._lag = velocity_lag

    def update(
        self,
        state: ArmState,
        reference: JointReference,
        dt: float,
        base: BaseMotion | None = None,
    ) -> JointCommand:
        """Return the effort (n,) [Nm] for this cycle of `dt` [s]."""
        q, dq, _ = state
        error = reference.q - q
        a = reference.ddq + self.kp * error
        if self._lag:
            dq = dq + self._lag * reference.ddq  # what the low-pass has not told yet
        a += self.kd * (reference.dq - dq)
        if self._integral is not None:
            a += self._integral.update(error, dt)
        if self._delay:
            gained = self._delay * reference.ddq
            q, dq = q + self._delay * reference.dq, dq + gained
            reference = reference._replace(dq=reference.dq + gained)
        # Friction along the reference: measured noise stays out.
        return JointCommand(tau=self._torque(q, dq, a, reference, base))
