"""Friction of the joints with all terms of an identified model."""

from dataclasses import replace

import numpy as np

from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.identification.joint_model import JointTerm, TermKind
from aerarm_ros.motion.signals import Array
from aerarm_ros.online.replay import KnownArm

_WIDTH = 0.01  # [rad/s] over which dry friction changes its direction
_TINY = np.asarray(1e-9)  # [rad/s], so that a velocity of 0 has a sign
_at_creep = np.asarray(0.02)  # [rad/s] at which the slowly rising part of friction counts as dry


class JointFriction(FrictionCompensation):
    """Joint friction with all identified terms, as a function of the measured velocity.

    It adds the terms that `FrictionCompensation` leaves out: saturating viscous friction,
    Stribeck friction, offsets, one-sided and coupled friction.

    Parameters
    ----------
    arm : KnownArm
    width : float
        Velocity over which dry friction changes its direction [rad/s].
    fraction : float
        Part of the friction that is compensated, 0 to 1.
    """

    def __init__(self, arm: KnownArm, width: float = _WIDTH, fraction: float = 1.0) -> None:
        viscous, coulomb, load = arm.friction
        super().__init__(viscous, coulomb, width, fraction, load)
        self._width = width
        self._dry, self._share = coulomb.copy(), load
        self._others: list[tuple[int, int, JointTerm, float]] = []
        for joint, term, value in arm.others:
            driver = joint if term.driver is None else term.driver
            smooth = term.smooth or term.kind is TermKind.STRIBECK or term.width > 0.0
            known = term if smooth else replace(term, width=width)
            self._others.append((joint, driver, known, fraction * value))
            if not term.smooth:
                self._dry[joint] += abs(value * float(known.basis(_at_creep, _at_creep, None)))

    def torque(self, dq: Array, load: Array | None = None, measured: Array | None = None) -> Array:
        """Return the friction torque (n,) [Nm] for given velocities and load torques on the links.

        Stribeck friction falls with speed, so that a joint that slips is faster than its reference
        and needs less. With the measured velocity it is compensated in the direction of the
        reference and by the size that it has at that velocity: the falling part is cancelled, and
        a joint whose reference rests is not driven.
        """
        torque = super().torque(dq, load)
        for joint, driver, term, value in self._others:
            speed = dq[driver]
            if term.kind is TermKind.STRIBECK:
                present = abs(speed if measured is None else measured[driver])
                basis = term.basis(present + _TINY, present, None) * np.tanh(speed / self._width)
            else:
                basis = term.basis(speed, speed, None)
            torque[joint] += value * float(basis)
        return torque

    def dry(self, load: Array) -> Array:
        """Return the largest dry friction (n,) [Nm] of joints at rest, for given load torques."""
        return np.asarray(self._dry + self._share * np.abs(load))

    def deficit(self, dq: Array) -> Array:
        """Return the fraction (n,) of dry friction that the smoothed model lacks at low speed."""
        return 1.0 - np.tanh(np.abs(dq) / self._width)
