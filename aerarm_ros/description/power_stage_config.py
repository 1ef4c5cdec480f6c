"""What stands between battery and motors."""

from dataclasses import dataclass

from aerarm_ros.description.config_error import ConfigError, check_range


@dataclass(frozen=True, slots=True)
class PowerStageConfig:
    """What the boards take for themselves, and what becomes of braking energy.

    Attributes
    ----------
    recovery : float
        Share of a braking motor's electrical power that the supply takes back, 0 to 1; the rest
        is burnt.
    standby : float
        Power of all boards with no current in any motor [W].
    voltage_min, voltage_max : float
        Supply voltages [V] beyond which the arm is stopped, where the boards report them.

    Raises
    ------
    ConfigError
        If a value lies outside its range.
    """

    recovery: float = 0.0
    standby: float = 0.0
    voltage_min: float = 0.0
    voltage_max: float = 1e3

    def __post_init__(self) -> None:
        """Check every value."""
        check_range('power_stage', 'recovery', self.recovery, 0.0, 1.0, '')
        check_range('power_stage', 'standby', self.standby, 0.0, 1e3, 'W')
        check_range('power_stage', 'voltage_min', self.voltage_min, 0.0, 1e3, 'V')
        check_range('power_stage', 'voltage_max', self.voltage_max, 0.0, 1e3, 'V')
        if self.voltage_min >= self.voltage_max:
            raise ConfigError(
                f'power_stage: voltage_min = {self.voltage_min} must be below voltage_max = '
                f'{self.voltage_max}'
            )
