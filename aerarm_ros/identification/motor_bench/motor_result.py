"""Parameters of one drive as measured by the motor bench."""

from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.motor_bench.motor_friction import MotorFriction, MotorResistance

# Largest relative standard deviation of the rotor inertia at which it counts as separable from
# the load.
_KNOWN = 0.3


@dataclass(frozen=True, eq=False)
class MotorResult:
    """Friction, inertia, torque constant and resistance of one joint's drive.

    Attributes
    ----------
    joint, motor : str
        Names in the arm's configuration.
    ratio : float
        Gear ratio k_g.
    torque_constant_stated : float
        Torque constant K_i that converted currents to torques [Nm/A].
    friction : MotorFriction
        Friction measured with the stated torque constant.
    inertia : tuple of two floats, or None
        Inertia that the drive accelerates at the joint, with its standard deviation [kg m^2],
        computed with the stated torque constant.
    carried_inertia : tuple of two floats
        Inertia of the load without the drive, with its standard deviation [kg m^2].
    torque_ratio : tuple of two floats, or None
        Ratio of true to stated torque constant, with its standard deviation; None if not measured.
    resistance : MotorResistance or None
        Phase resistance; None if neither voltages nor the board provide it.
    backlash : tuple of two floats, or None
        Gear backlash at the joint, with its standard deviation [rad]; None if not measured.
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
        """Ratio of true to measured torque; 1 if the torque constant was not measured."""
        return self.torque_ratio[0] if self.torque_ratio else 1.0

    @property
    def viscous(self) -> tuple[float, float]:
        """Viscous friction b_eq / k_g^2 at the joint, with its standard deviation [Nms/rad]."""
        friction = self.friction
        return self.scale * friction.viscous, self.scale * float(friction.std[0])

    @property
    def viscous_motor(self) -> tuple[float, float]:
        """Motor-side b_eq of thesis table 4.3, with its standard deviation [Nms/rad]."""
        value, std = self.viscous
        return self.ratio**2 * value, self.ratio**2 * std

    @property
    def coulomb(self) -> tuple[float, float]:
        """Coulomb friction f of thesis table 4.3 at the joint, with its standard deviation [Nm]."""
        return self.scale * self.friction.coulomb, self.scale * float(self.friction.std[1])

    @property
    def torque_constant(self) -> tuple[float, float] | None:
        """Torque constant K_i [Nm/A] with its standard deviation, None if not measured."""
        if self.torque_ratio is None:
            return None
        stated = self.torque_constant_stated
        return stated * self.torque_ratio[0], stated * self.torque_ratio[1]

    @property
    def rotor_inertia(self) -> tuple[float, float] | None:
        """Motor-side rotor inertia J_m [kg m^2], with standard deviation; None if not measured."""
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
