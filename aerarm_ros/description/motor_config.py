"""One kind of motor."""

from __future__ import annotations

import math
from dataclasses import dataclass

from aerarm_ros.description.config_error import ConfigError, check_name, check_range

RATED_AMBIENT = 25.0
"""Ambient temperature for which a continuous current is stated [degC]."""
COPPER = 0.00393
"""Growth of copper's resistance per kelvin, as a share of that at 20 degC (IEC 60028) [1/K]."""
# A motor without data: of its short-time current this share counts as continuous. Small outrunners
# without the airflow of a propeller bear 0.3 to 0.5 of what their data sheets state for 180 s.
_GUESSED_SHARE = 0.33


@dataclass(frozen=True, slots=True)
class ThermalConfig:
    """Continuous current and time constants of a motor as it is mounted.

    Attributes
    ----------
    continuous_current : float
        Quadrature current [A] that brings the winding to `temperature_max` after a long time, at
        an ambient temperature of 25 degC.
    temperature_max : float
        Of the winding [degC]: below what its insulation, the magnets and the mount bear.
    winding_time : float
        Time constant of the winding with its stator against the housing [s].
    housing_time : float
        Time constant of the housing with its mount against the air [s].
    housing_share : float
        Share of the thermal resistance that lies between housing and air.

    Raises
    ------
    ConfigError
        If a value lies outside its range.
    """

    continuous_current: float
    temperature_max: float = 110.0
    winding_time: float = 25.0
    housing_time: float = 300.0
    housing_share: float = 0.6

    def __post_init__(self) -> None:
        """Check every value."""
        owner = 'thermal'
        check_range(owner, 'continuous_current', self.continuous_current, 1e-3, 500.0, 'A')
        check_range(owner, 'temperature_max', self.temperature_max, 60.0, 250.0, 'degC')
        check_range(owner, 'winding_time', self.winding_time, 0.5, 3600.0, 's')
        check_range(owner, 'housing_time', self.housing_time, 0.5, 36000.0, 's')
        check_range(owner, 'housing_share', self.housing_share, 0.05, 0.95, '')
        if self.housing_time < self.winding_time:
            raise ConfigError(
                f'{owner}: housing_time = {self.housing_time} is below winding_time = '
                f'{self.winding_time}: the housing warms more slowly than the winding'
            )

    @classmethod
    def guessed(cls, current_max: float) -> ThermalConfig:
        """Return a cautious guess for a motor of which only the short-time current [A] is known."""
        return cls(float(f'{_GUESSED_SHARE * current_max:.2g}'))


def torque_constant(kv: float) -> float:
    """Return the torque constant [Nm/A] of a motor from its velocity constant, thesis (4.3).

    Holds for a field-oriented current (amplitude of the phase current, i_d = 0) and a `kv`
    given for the line-to-line voltage; `3/2 / sqrt(3)` comes from those two conventions.

    Parameters
    ----------
    kv : float
        Velocity constant [rpm/V].
    """
    return 1.5 / math.sqrt(3.0) * 60.0 / (2.0 * math.pi) / kv


@dataclass(frozen=True, slots=True)
class MotorConfig:
    """A brushless motor, thesis table 4.1.

    Attributes
    ----------
    name : str
        Type, e.g. 'MN5006'.
    pole_pairs : int
    kv : float
        Velocity constant for the line-to-line voltage [rpm/V].
    current_max : float
        Largest quadrature current [A].
    rotor_inertia : float
        J_m [kg m^2], motor side.
    resistance : float
        Of one phase [ohm].
    torque_constant_measured : float or None
        K_i [Nm/A] from a motor bench; None to compute it from `kv`.
    resistance_std : float or None
        Standard deviation of `resistance` [ohm], from a motor bench; None for an estimate.
    thermal : ThermalConfig or None
        How warm it gets; None if nothing is known of that.

    Raises
    ------
    ConfigError
        If a value isn't a number or lies outside any plausible range.
    """

    name: str
    pole_pairs: int
    kv: float
    current_max: float
    rotor_inertia: float
    resistance: float
    torque_constant_measured: float | None = None
    resistance_std: float | None = None
    thermal: ThermalConfig | None = None

    def __post_init__(self) -> None:
        """Check every value."""
        check_name('motor', 'name', self.name)
        owner = f'motor {self.name}'
        check_range(owner, 'pole_pairs', self.pole_pairs, 1, 100, '')
        check_range(owner, 'kv', self.kv, 1.0, 2e4, 'rpm/V')
        check_range(owner, 'current_max', self.current_max, 1e-3, 500.0, 'A')
        check_range(owner, 'rotor_inertia', self.rotor_inertia, 0.0, 1e-2, 'kg m^2')
        check_range(owner, 'resistance', self.resistance, 1e-4, 100.0, 'ohm')
        if self.torque_constant_measured is not None:
            key = 'torque_constant_measured'
            check_range(owner, key, self.torque_constant_measured, 1e-5, 10.0, 'Nm/A')
        if self.resistance_std is not None:
            check_range(owner, 'resistance_std', self.resistance_std, 0.0, 100.0, 'ohm')
        if self.thermal is not None and self.thermal.continuous_current > self.current_max:
            raise ConfigError(
                f'{owner}: continuous_current = {self.thermal.continuous_current} of thermal is '
                f'above current_max = {self.current_max}: lower it'
            )

    @property
    def thermal_or_guess(self) -> ThermalConfig:
        """How warm it gets, guessed from `current_max` where the configuration does not say."""
        return self.thermal or ThermalConfig.guessed(self.current_max)

    @property
    def torque_constant(self) -> float:
        """K_i [Nm/A]: the measured one, or that of thesis (4.3)."""
        if self.torque_constant_measured is not None:
            return self.torque_constant_measured
        return torque_constant(self.kv)

    @property
    def resistance_text(self) -> str:
        """The resistance with its uncertainty, if it is known."""
        known = 'an estimate' if self.resistance_std is None else f'± {self.resistance_std:.2g}'
        return f'{self.resistance:.4g} ({known})'
