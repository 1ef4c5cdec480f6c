"""What the motor bench found out about one drive."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.motor_bench.motor_friction import MotorFriction, MotorResistance

# A rotor's inertia is told apart from its links' if it is known to this share.
_KNOWN = 0.3


@dataclass(frozen=True, eq=False)
class MotorResult:
    """Friction, inertia, torque constant and resistance of one joint's drive.

    Attributes
    ----------
    joint, motor : str
        Names in the arm's configuration.
    ratio : float
        k_g.
    torque_constant_stated : float
        K_i by which currents were converted to torque [Nm/A].
    friction : MotorFriction
        As measured with the stated torque constant.
    inertia : tuple of two floats, or None
        What the joint accelerates, and its standard deviation, likewise [kg m^2].
    carried_inertia : tuple of two floats
        Part of it that is not the drive's, and its standard deviation [kg m^2].
    torque_ratio : tuple of two floats, or None
        True over stated torque constant, and its standard deviation; None if not measured.
    resistance : MotorResistance or None
        Of the motor's phase; None if neither voltages nor the board tell it.
    backlash : tuple of two floats, or None
        Play of the gear at the joint, and its standard deviation [rad]; None if not measured.
    """

    joint: str
    motor: str
    ratio: float
    torque_constant_stated: float
    friction: MotorFriction
    inertia: tuple[float, float] | None = None
    carried_inertia: tuple[float, float] = (0.0, 0.0)
    torque_ratio: tuple[float, float] | None = None
    resistance: MotorResistance | None = None
    backlash: tuple[float, float] | None = None

    @property
    def scale(self) -> float:
        """True over measured torque; 1 if the torque constant was not measured."""
        return self.torque_ratio[0] if self.torque_ratio else 1.0

    @property
    def viscous(self) -> tuple[float, float]:
        """b_eq / k_g^2, at the joint, and its standard deviation [Nms/rad]."""
        friction = self.friction
        return self.scale * friction.viscous, self.scale * float(friction.std[0])

    @property
    def viscous_motor(self) -> tuple[float, float]:
        """b_eq of thesis table 4.3, motor side, and its standard deviation [Nms/rad]."""
        value, std = self.viscous
        return self.ratio**2 * value, self.ratio**2 * std

    @property
    def coulomb(self) -> tuple[float, float]:
        """Coulomb friction f of thesis table 4.3, at the joint, and its standard deviation [Nm]."""
        return self.scale * self.friction.coulomb, self.scale * float(self.friction.std[1])

    @property
    def torque_constant(self) -> tuple[float, float] | None:
        """K_i [Nm/A] and its standard deviation, None if not measured."""
        if self.torque_ratio is None:
            return None
        stated = self.torque_constant_stated
        return stated * self.torque_ratio[0], stated * self.torque_ratio[1]

    @property
    def rotor_inertia(self) -> tuple[float, float] | None:
        """J_m [kg m^2], motor side, and its standard deviation; None if not measured."""
        if self.inertia is None:
            return None
        (total, std), (carried, carried_std) = self.inertia, self.carried_inertia
        value = self.scale * total - carried
        return self.ratio**2 * value, self.ratio**2 * float(np.hypot(std, carried_std))

    @property
    def rotor_inertia_known(self) -> bool:
        """Whether rotor and load inertia are separable."""
        found = self.rotor_inertia
        return found is not None and 0.0 < found[1] < _KNOWN * found[0]
