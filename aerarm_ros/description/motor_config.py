"""One kind of motor."""

import math
from dataclasses import dataclass

from aerarm_ros.description.config_error import check_name, check_range


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
