"""Configuration of drives in `config/aerarm.yaml`: motors, gears and joints."""

from __future__ import annotations

import math
from dataclasses import dataclass

from aerarm_ros.description.config_reader import ConfigError, check_fields, one_of, ranged


@dataclass(frozen=True, slots=True)
class GearConfig:
    """Reduction gear, thesis section 4.2.

    Attributes
    ----------
    kind : str
        Type, for example 'cycloidal'.
    ratio : float
        k_g = joint speed / motor speed, thesis (4.6), below one for a reduction gear [-].
    efficiency : float
        Fraction of the motor's torque that the gear transmits, eta_g of thesis (4.7) [-].

    Raises
    ------
    ConfigError
        If a value is outside its range, for example for an inverse ratio.
    """

    kind: str
    ratio: float = ranged(1e-4, 1.0, 'joint speed / motor speed')
    efficiency: float = ranged(0.01, 1.0, default=1.0)

    def __post_init__(self) -> None:
        """Validate all values."""
        check_fields(f'gear {self.kind}', self)


RATED_AMBIENT = 25.0
"""Ambient temperature at which a motor bears its continuous current [degC]."""
COPPER = 0.00393
"""Temperature coefficient of copper's resistance at 20 degC (IEC 60028) [1/K]."""
# Continuous current as a fraction of the short-time current, for a motor without data. Small
# outrunners without the airflow of a propeller bear 0.3 to 0.5 of the current that their data
# sheets allow for 180 s.
_GUESSED_SHARE = 0.33


@dataclass(frozen=True, slots=True)
class ThermalConfig:
    """Thermal data of a motor, mounted as in the arm.

    Attributes
    ----------
    continuous_current : float
        Constant quadrature current [A] at which the winding settles at `temperature_max`, with
        ambient air at 25 degC.
    temperature_max : float
        Largest winding temperature [degC], below the limits of insulation, magnets and mount.
    winding_time : float
        Time constant between the winding (with its stator) and the housing [s].
    housing_time : float
        Time constant between the housing (with its mount) and the air [s].
    housing_share : float
        Thermal resistance from housing to air, as a fraction of the thermal resistance from
        winding to air [-].

    Raises
    ------
    ConfigError
        If a value is outside its range.
    """

    continuous_current: float = ranged(1e-3, 500.0, 'A')
    temperature_max: float = ranged(60.0, 250.0, 'degC', default=110.0)
    winding_time: float = ranged(0.5, 3600.0, 's', default=25.0)
    housing_time: float = ranged(0.5, 36000.0, 's', default=300.0)
    housing_share: float = ranged(0.05, 0.95, default=0.6)

    def __post_init__(self) -> None:
        """Validate all values."""
        check_fields('thermal', self)
        if self.housing_time < self.winding_time:
            raise ConfigError(
                f'thermal: housing_time = {self.housing_time} must not be below winding_time = '
                f'{self.winding_time}, because the housing warms more slowly than the winding'
            )

    @classmethod
    def guessed(cls, current_max: float) -> ThermalConfig:
        """Return cautious estimates of a motor's thermal data, from its short-time current [A]."""
        return cls(float(f'{_GUESSED_SHARE * current_max:.2g}'))


def torque_constant(kv: float) -> float:
    """Return the torque constant [Nm/A] of a motor from its velocity constant, thesis (4.3).

    The formula assumes field-oriented control with i_d = 0, a quadrature current equal to the
    amplitude of the phase current, and a `kv` for the line-to-line voltage. The factor `3/2 /
    sqrt(3)` follows from these conventions.

    Parameters
    ----------
    kv : float
        Velocity constant [rpm/V].
    """
    return 1.5 / math.sqrt(3.0) * 60.0 / (2.0 * math.pi) / kv


@dataclass(frozen=True, slots=True)
class MotorConfig:
    """Brushless motor, thesis table 4.1.

    Attributes
    ----------
    name : str
        Motor type, for example 'MN5006'.
    kv : float
        Velocity constant for the line-to-line voltage [rpm/V].
    current_max : float
        Largest quadrature current [A].
    rotor_inertia : float
        Motor-side rotor inertia J_m [kg m^2].
    resistance : float
        Phase resistance [ohm].
    torque_constant_measured : float or None
        Torque constant K_i [Nm/A] from a motor bench; None to compute it from `kv`.
    resistance_std : float or None
        Standard deviation of `resistance` [ohm] from a motor bench; None for an estimate.
    thermal : ThermalConfig or None
        Thermal data; None if unknown.

    Raises
    ------
    ConfigError
        If a value is not a number or outside any plausible range.
    """

    name: str
    pole_pairs: int = ranged(1, 100)
    kv: float = ranged(1.0, 2e4, 'rpm/V')
    current_max: float = ranged(1e-3, 500.0, 'A')
    rotor_inertia: float = ranged(0.0, 1e-2, 'kg m^2')
    resistance: float = ranged(1e-4, 100.0, 'ohm')
    torque_constant_measured: float | None = ranged(1e-5, 10.0, 'Nm/A', default=None)
    resistance_std: float | None = ranged(0.0, 100.0, 'ohm', default=None)
    thermal: ThermalConfig | None = None

    def __post_init__(self) -> None:
        """Validate all values."""
        check_fields(f'motor {self.name}', self)
        if self.thermal is not None and self.thermal.continuous_current > self.current_max:
            raise ConfigError(
                f'motor {self.name}: continuous_current = {self.thermal.continuous_current} '
                f'(thermal) is above current_max = {self.current_max}; lower continuous_current'
            )

    @property
    def thermal_or_guess(self) -> ThermalConfig:
        """Thermal data of the motor; estimated from `current_max` if not configured."""
        return self.thermal or ThermalConfig.guessed(self.current_max)

    @property
    def torque_constant(self) -> float:
        """Torque constant K_i [Nm/A], measured on a motor bench or computed by thesis (4.3)."""
        if self.torque_constant_measured is not None:
            return self.torque_constant_measured
        return torque_constant(self.kv)

    @property
    def resistance_text(self) -> str:
        """Phase resistance as text, with the standard deviation of a measured resistance."""
        known = 'an estimate' if self.resistance_std is None else f'± {self.resistance_std:.2g}'
        return f'{self.resistance:.4g} ({known})'


# Two turns in radians; a larger value is probably in degrees.
_POSITION_BOUND = 12.6


@dataclass(frozen=True, slots=True)
class JointConfig:
    """Joint with its motor, gear and limits; values refer to the joint side unless stated.

    Attributes
    ----------
    name : str
        Name in the URDF.
    board : int
        Index of the board in `ArmConfig.boards`.
    channel : int
        Channel of the motor on the board, 0 or 1.
    sign : int
        -1 if the motor turns against the joint, otherwise 1.
    offset : float
        Joint angle [rad] at encoder zero.
    position_min, position_max : float
        Position limits [rad].
    velocity_max, acceleration_max : float
        Velocity limit [rad/s] and acceleration limit [rad/s^2].
    effort_max : float
        Torque limit [Nm], at most the motor's torque at its largest current.
    effort_rate_max : float
        Limit of the torque rate [Nm/s].
    viscous, coulomb : float
        Viscous friction f_v [Nms/rad] and Coulomb friction f_s [Nm] of thesis (2.6).
    board_kp, board_kd : float
        Gains of the board's control law, thesis (4.4), motor side [A/rad], [A s/rad].

    Raises
    ------
    ConfigError
        If a value is outside its range or contradicts another.
    """

    name: str
    motor: MotorConfig
    gear: GearConfig
    board: int = ranged(0, 100)
    channel: int = one_of(0, 1)
    sign: int = one_of(1, -1)
    offset: float = ranged(-_POSITION_BOUND, _POSITION_BOUND, 'rad')
    position_min: float = ranged(-_POSITION_BOUND, _POSITION_BOUND, 'rad')
    position_max: float = ranged(-_POSITION_BOUND, _POSITION_BOUND, 'rad')
    velocity_max: float = ranged(1e-3, 50.0, 'rad/s')
    acceleration_max: float = ranged(1e-3, 1e4, 'rad/s^2')
    effort_max: float = ranged(1e-3, 1e3, 'Nm')
    effort_rate_max: float = ranged(1e-2, 1e6, 'Nm/s')
    viscous: float = ranged(0.0, 100.0, 'Nms/rad')
    coulomb: float = ranged(0.0, 100.0, 'Nm')
    board_kp: float = ranged(0.0, 1e3, 'A/rad')
    board_kd: float = ranged(0.0, 1e3, 'A s/rad')

    def __post_init__(self) -> None:
        """Validate all values."""
        owner = f'joint {self.name}'
        check_fields(owner, self)
        if self.position_min >= self.position_max:
            raise ConfigError(
                f'{owner}: position_min = {self.position_min} must be below '
                f'position_max = {self.position_max}'
            )
        strongest = self.torque_per_ampere * self.motor.current_max
        if self.effort_max > 1.01 * strongest:
            raise ConfigError(
                f'{owner}: effort_max = {self.effort_max} Nm exceeds the {strongest:.2f} Nm of '
                f"motor {self.motor.name} at current_max; lower effort_max, or check the motor's "
                'kv and current_max and the gear ratio'
            )

    @property
    def torque_per_ampere(self) -> float:
        """Joint torque per motor current [Nm/A]: K_i eta / k_g, thesis (4.2), (4.7)."""
        return self.motor.torque_constant * self.gear.efficiency / self.gear.ratio

    @property
    def reflected_inertia(self) -> float:
        """Rotor inertia reflected to the joint [kg m^2]: J_m / k_g^2."""
        return self.motor.rotor_inertia / self.gear.ratio**2
