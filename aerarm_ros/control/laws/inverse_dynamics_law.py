"""What the laws that invert the arm's dynamics have in common."""

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.compensation.error_integral import ErrorIntegral
from aerarm_ros.control.compensation.friction_compensation import FrictionCompensation
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


class InverseDynamicsLaw:
    """Torque for an acceleration, thesis (2.18), with friction and an integral if wanted.

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

    def take_over(self, q: FloatArray) -> None:
        """Start at the present posture, without integral."""
        if self._integral is not None:
            self._integral.reset()

    def _torque(
        self,
        q: FloatArray,
        dq: FloatArray,
        a: FloatArray,
        along: JointReference,
        base: BaseMotion | None,
    ) -> FloatArray:
        """Return the torque (n,) [Nm] for an acceleration `a` [rad/s^2] at q [rad], dq [rad/s].

        Friction is compensated as on the reference `along`, and a base that answers is expected
        to answer what is planned there.
        """
        u = self._dynamics.inverse(q, dq, a, base, along.ddq)
        if self._friction is not None:
            load = u - self._dynamics.fixed.rotor_inertia * a
            u = u + self._friction.torque(along.dq, load)
        return u
