"""Position control with gravity compensation, thesis 2.6.1, and hand guiding."""

import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import non_negative, positive
from aerarm_ros.control.compensation import Fade, FrictionCompensation
from aerarm_ros.motion.signals import ArmState, Array, JointCommand, JointReference

HAND_GUIDING_DAMPING = 0.02
"""Fraction of Kd that remains in hand guiding, so that a released arm comes to rest."""


class GravityCompensation:
    """PD control with gravity and friction compensation, thesis (2.14).

    The law is `u = g(q) + Kp (qd - q) + Kd (dqd - dq)` plus friction. With `hand_guiding` the gains
    fade to nearly zero. Gravity and part of the friction are still compensated, so that a person
    can move the arm. Gains fade over `fade_time` in both directions, so the torque never jumps. A
    caller that ends hand guiding must let the reference start at the present posture.

    Parameters
    ----------
    kp : (n,) array_like
        Gains Kp of the position error [Nm/rad].
    kd : (n,) array_like
        Gains Kd of the velocity error [Nms/rad].
    friction : FrictionCompensation, optional
        Compensation by the reference velocity: at rest it is zero and cannot chatter.
    hand_friction : FrictionCompensation, optional
        Compensation by the measured velocity during hand guiding; its fraction must be below one.
    fade_time : float
        Time in which the gains fade from one mode to the other [s].

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
        friction: FrictionCompensation | None = None,
        hand_friction: FrictionCompensation | None = None,
        fade_time: float = 0.5,
    ) -> None:
        self._dynamics = dynamics
        self.kp = non_negative('kp', kp, dynamics.n)
        self.kd = non_negative('kd', kd, dynamics.n)
        self._friction = friction
        self._hand_friction = hand_friction
        self._fade = Fade(positive('fade_time', fade_time), share=1.0)
        self.hand_guiding = False
        self.stiffness_share = 1.0

    @property
    def stiffness(self) -> float:
        """Effective fraction of Kp and Kd, from 0 (hand guiding) to 1 (position control)."""
        return self._fade.share

    def take_over(self, q: Array) -> None:
        """Reset the gains: full in position control, zero in hand guiding."""
        self._fade.share = 0.0 if self.hand_guiding else 1.0

    def update(
        self, state: ArmState, reference: JointReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the joint efforts (n,) [Nm] for this cycle of `dt` [s]."""
        stiffness = self._fade.update(dt, not self.hand_guiding)
        q, dq, _ = state
        damping = stiffness + (1.0 - stiffness) * HAND_GUIDING_DAMPING
        load = self._dynamics.gravity(q, base, reference.ddq)
        u = load + stiffness * self.stiffness_share * self.kp * (reference.q - q)
        u += damping * self.kd * (stiffness * reference.dq - dq)
        if self._friction is not None:
            u += stiffness * self._friction.torque(reference.dq, load)
        if self._hand_friction is not None and stiffness < 1.0:
            u += (1.0 - stiffness) * self._hand_friction.torque(dq, load)
        return JointCommand(tau=u)
