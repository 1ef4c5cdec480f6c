"""Computed torque control, thesis 2.6.2, with the feedback on the host or on the boards."""

import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import non_negative
from aerarm_ros.control.compensation import ErrorIntegral, FrictionCompensation
from aerarm_ros.motion.signals import ArmState, Array, JointCommand, JointReference


class InverseDynamicsLaw:
    """Base class: inverse dynamics, thesis (2.18), with friction and an integral term.

    Parameters
    ----------
    integral : ErrorIntegral, optional
        Integral of the error, with gain in [1/s^3] and limit in [rad/s^2], because it acts through
        B(q).
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
        """Reset the integral term to zero."""
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
        """Return the joint torques (n,) [Nm] for a desired acceleration `a` (n,) [rad/s^2].

        Friction is compensated for the velocity of the reference `along`, its part that falls with
        speed for the `measured` velocity (n,) [rad/s]. A base that responds is assumed to respond
        to the reference's acceleration.
        """
        u = self._dynamics.inverse(q, dq, a, base, along.ddq)
        if self._friction is not None:
            load = u - self._dynamics.fixed.rotor_inertia * a
            u = u + self._friction.torque(along.dq, load, measured)
        return u


class ComputedTorque(InverseDynamicsLaw):
    """Computed torque law with feedback on the host, thesis (2.21).

    The law is `u = B(q) a + n(q, dq)` with `a = ddqd + Kp (qd - q) + Kd (dqd - dq)`. The error
    obeys (2.22), `dde + Kd de + Kp e = 0`, in every joint and posture. An integral of the error
    can be added to `a` (the PID of thesis 2.6.2). Friction is compensated for the reference
    velocity.

    The error equation assumes a torque that acts at once and a velocity without delay. With `delay`
    the model is evaluated at the time when the torque acts, with the acceleration assumed constant
    until then. With `velocity_lag` measured velocities are corrected for the lag of their filter.
    The corrections by `delay` and `velocity_lag` use only the reference, so the feedback loop does
    not change.

    Parameters
    ----------
    kp : (n,) array_like
        Gains Kp of the position error [1/s^2].
    kd : (n,) array_like
        Gains Kd of the velocity error [1/s]; `2 sqrt(kp)` damps critically.
    integral : ErrorIntegral, optional
        Integral of the error, with gain in [1/s^3] and limit in [rad/s^2].
    delay : float
        Time from a state to the middle of the interval in which its command acts [s].
    velocity_lag : float
        Time constant of the low-pass on measured velocities [s].

    Attributes
    ----------
    kp, kd : (n,) ndarray
        May be replaced at any time.
    stiffness_share : float
        Share of kp in effect, 1 unless the arm complies with a contact.

    Raises
    ------
    ValueError
        If a gain is negative or their number is not n.
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
        self, state: ArmState, reference: JointReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the joint efforts (n,) [Nm] for this cycle of `dt` [s]."""
        q, dq, _ = state
        error = reference.q - q
        a = reference.ddq + self.stiffness_share * self.kp * error
        if self._lag:
            dq = dq + self._lag * reference.ddq  # lag of the low-pass
        a += self.kd * (reference.dq - dq)
        if self._integral is not None and self.stiffness_share == 1.0:
            a += self._integral.update(error, dt)
        if self._delay:
            gained = self._delay * reference.ddq
            q, dq = q + self._delay * reference.dq, dq + gained
            reference = reference._replace(dq=reference.dq + gained)
        # Friction for the reference velocity, without measured noise.
        return JointCommand(tau=self._torque(q, dq, a, reference, base, state.dq))


class BoardComputedTorque(InverseDynamicsLaw):
    """Inverse dynamics (2.18) as feedforward for the position control (4.4) of the boards.

    The boards add `Kp (qd - q) + Kd (dqd - dq)` at 40 kHz, so the host's cycle does not delay the
    feedback. In exchange the gains are torques per error, not multiplied by B(q), so the joints'
    errors are coupled. For the parameters see `InverseDynamicsLaw`. The boards' gains do not
    change, so `stiffness_share` has no effect.
    """

    stiffness_share = 1.0

    def update(
        self, state: ArmState, reference: JointReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return position [rad] and velocity [rad/s] of the reference, and effort [Nm], (n,)."""
        a = reference.ddq
        if self._integral is not None:
            a = a + self._integral.update(reference.q - state.q, dt)
        # Nonlinear terms at the reference, without measured noise; the boards' stiff loop keeps
        # the arm close to it.
        u = self._torque(reference.q, reference.dq, a, reference, base, state.dq)
        return JointCommand(reference.q, reference.dq, u)
