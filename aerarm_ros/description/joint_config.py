"""One joint: its drive, where it is connected, and what it may do."""

from dataclasses import dataclass

from aerarm_ros.description.config_error import (
    ConfigError,
    check_choice,
    check_name,
    check_range,
)
from aerarm_ros.description.gear_config import GearConfig
from aerarm_ros.description.motor_config import MotorConfig

# Two turns: beyond, a position is more likely in degrees.
_POSITION_BOUND = 12.6

# (field, smallest, largest, unit)
_RANGES = (
    ('offset', -_POSITION_BOUND, _POSITION_BOUND, 'rad'),
    ('position_min', -_POSITION_BOUND, _POSITION_BOUND, 'rad'),
    ('position_max', -_POSITION_BOUND, _POSITION_BOUND, 'rad'),
    ('velocity_max', 1e-3, 50.0, 'rad/s'),
    ('acceleration_max', 1e-3, 1e4, 'rad/s^2'),
    ('effort_max', 1e-3, 1e3, 'Nm'),
    ('effort_rate_max', 1e-2, 1e6, 'Nm/s'),
    ('viscous', 0.0, 100.0, 'Nms/rad'),
    ('coulomb', 0.0, 100.0, 'Nm'),
    ('board_kp', 0.0, 1e3, 'A/rad'),
    ('board_kd', 0.0, 1e3, 'A s/rad'),
)


@dataclass(frozen=True, slots=True)
class JointConfig:
    """A driven joint; values are joint side unless they say motor side.

    Attributes
    ----------
    name : str
        As in the URDF.
    motor : MotorConfig
    gear : GearConfig
    board : int
        Number of the board in `ArmConfig.boards`.
    channel : int
        0 or 1: which motor of the board.
    sign : int
        -1 if the motor turns against the joint, else 1.
    offset : float
        Joint angle [rad] at encoder zero.
    position_min, position_max : float
        [rad]
    velocity_max, acceleration_max : float
        [rad/s], [rad/s^2]
    effort_max : float
        [Nm]; not above what the motor gives at its largest current.
    effort_rate_max : float
        [Nm/s]
    viscous, coulomb : float
        f_v [Nms/rad] and f_s [Nm] of thesis (2.6).
    board_kp, board_kd : float
        Gains of thesis (4.4), motor side [A/rad], [A s/rad].

    Raises
    ------
    ConfigError
        If a value lies outside its range or contradicts another.
    """

    name: str
    motor: MotorConfig
    gear: GearConfig
    board: int
    channel: int
    sign: int
    offset: float
    position_min: float
    position_max: float
    velocity_max: float
    acceleration_max: float
    effort_max: float
    effort_rate_max: float
    viscous: float
    coulomb: float
    board_kp: float
    board_kd: float

    def __post_init__(self) -> None:
        """Check every value."""
        check_name('joint', 'name', self.name)
        owner = f'joint {self.name}'
        check_range(owner, 'board', self.board, 0, 100, '')
        check_choice(owner, 'channel', self.channel, (0, 1))
        check_choice(owner, 'sign', self.sign, (1, -1))
        for key, low, high, unit in _RANGES:
            check_range(owner, key, getattr(self, key), low, high, unit)
        if self.position_min >= self.position_max:
            raise ConfigError(
                f'{owner}: position_min = {self.position_min} must be below '
                f'position_max = {self.position_max}'
            )
        strongest = self.torque_per_ampere * self.motor.current_max
        if self.effort_max > 1.01 * strongest:
            raise ConfigError(
                f'{owner}: effort_max = {self.effort_max} Nm is more than motor '
                f'{self.motor.name} gives at its current_max, {strongest:.2f} Nm: lower it, or '
                "check the motor's kv and current_max and the gear's ratio"
            )

    @property
    def torque_per_ampere(self) -> float:
        """Joint torque per motor current [Nm/A]: K_i eta / k_g, thesis (4.2), (4.7)."""
        return self.motor.torque_constant * self.gear.efficiency / self.gear.ratio

    @property
    def reflected_inertia(self) -> float:
        """Rotor inertia as the joint feels it [kg m^2]: J_m / k_g^2."""
        return self.motor.rotor_inertia / self.gear.ratio**2
