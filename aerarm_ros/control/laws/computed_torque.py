"""Trajectory tracking by computed torque, thesis 2.6.2, with the loop closed on the host."""

import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import non_negative
from aerarm_ros.control.compensation import ErrorIntegral, FrictionCompensation
from aerarm_ros.motion.signals import ArmState, Array, JointCommand, JointReference


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

    def take_over(self, q: Array) -> None:
        """Start at the present posture, without integral."""
        if self._integral is not None:
            self._integral.reset()

    def _torque(
        self,
        q: Array,
        dq: Array,
        a: Array,
        along: JointReference,
        base: BaseMotion | None,
        measured: Array,
    ) -> Array:
        """Return the torque (n,) [Nm] for an acceleration `a` [rad/s^2] at q [rad], dq [rad/s].

        Friction is compensated as on the reference `along`, its part that falls with speed by the
        `measured` velocity (n,) [rad/s], and a base that answers is expected to answer what is
        planned there.
        """
        u = self._dynamics.inverse(q, dq, a, base, along.ddq)
        if self._friction is not None:
            load = u - self._dynamics.fixed.rotor_inertia * a
            u = u + self._friction.torque(along.dq, load, measured)
        return u


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
    stiffness_share : float
        Share of kp in effect, 1 unless the arm complies with a contact.

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
        self.stiffness_share = 1.0
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
        a = reference.ddq + self.stiffness_share * self.kp * error
        if self._lag:
            dq = dq + self._lag * reference.ddq  # what the low-pass has not told yet
        a += self.kd * (reference.dq - dq)
        if self._integral is not None and self.stiffness_share == 1.0:
            a += self._integral.update(error, dt)
        if self._delay:
            gained = self._delay * reference.ddq
            q, dq = q + self._delay * reference.dq, dq + gained
            reference = reference._replace(dq=reference.dq + gained)
        # Friction along the reference: measured noise stays out.
        return JointCommand(tau=self._torque(q, dq, a, reference, base, state.dq))


class BoardComputedTorque(InverseDynamicsLaw):
    """Inverse dynamics as feed-forward to the boards' law, thesis (2.18) and (4.4).

    The boards add `Kp (qd - q) + Kd (dqd - dq)` at 40 kHz, so the feedback sees neither the
    host's cycle nor its delay; in exchange the gains are torques per error, not shaped by
    B(q), and errors of the joints stay coupled. Made of what `InverseDynamicsLaw` is made of. The
    boards' gains stay, so that `stiffness_share` has no effect.
    """

    stiffness_share = 1.0

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
        u = self._torque(reference.q, reference.dq, a, reference, base, state.dq)
        return JointCommand(reference.q, reference.dq, u)
