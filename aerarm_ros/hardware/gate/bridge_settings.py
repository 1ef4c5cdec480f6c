"""Times and tolerances of the bridge that parameters can change."""

from dataclasses import dataclass, field, fields
from typing import Any


def _setting(values: tuple[float, float, float, str], description: str) -> Any:
    """Return a field that a parameter is made of; values: default, minimum, maximum, unit."""
    default, *bounds, unit = values
    about = {'bounds': bounds, 'unit': unit, 'description': description}
    return field(default=default, metadata=about)


@dataclass(frozen=True)
class BridgeSettings:
    """Times and tolerances of the bridge; each has a default, bounds, a unit and a description.

    The bounds are wide enough for another light arm, a busy host or a slow bus, and narrow enough
    that each stop still occurs when needed.
    """

    # The barriers' load observer needs states at least this often.
    period: float = _setting((1e-3, 0.0005, 0.004, 's'), "period of the bridge's cycle")
    command_timeout: float = _setting(
        (0.05, 0.002, 1.0, 's'),
        'age of the last accepted joint command above which the bridge damps the arm',
    )
    stamp_age_max: float = _setting(
        (0.05, 0.002, 1.0, 's'),
        'age of a joint state above which the bridge rejects a command computed from this joint '
        'state',
    )
    # One byte in the frame; 0 would mean no time-out. Decision 32.
    board_timeout: float = _setting(
        (0.04, 0.001, 0.255, 's'),
        'time without a valid frame after which a board switches its motors off',
    )
    bad_frames_max: int = _setting(
        (10, 1, 1000, ''),
        'number of consecutive invalid frames from a board at which the bridge enters fault',
    )
    lost_commands_max: int = _setting(
        (10, 1, 1000, ''),
        'number of consecutive lost commands at which the bridge enters fault; a lost command '
        'has not reached a board that still sends frames',
    )
    lost_commands_warning: float = _setting(
        (0.01, 0.001, 1.0, ''),
        'fraction of commands that a board has not received during the last second, above which '
        'the bridge warns',
    )
    state_age_max: float = _setting(
        (0.02, 0.002, 1.0, 's'),
        'time for which all data of a board may stay unchanged before the bridge enters fault',
    )
    exchange_time_max: float = _setting(
        (0.5e-3, 2e-5, 0.1, 's'),
        'duration above which an exchange of SPI frames with the boards counts as slow',
    )
    slow_exchanges_max: int = _setting(
        (10, 1, 1000, ''), 'number of consecutive slow exchanges at which the bridge enters fault'
    )
    connect_frames: int = _setting(
        (5, 1, 1000, ''),
        'number of consecutive valid frames after which a board counts as connected',
    )
    alignment_timeout: float = _setting(
        (6.0, 0.1, 60.0, 's'), 'duration of the motor alignment above which the bridge enters fault'
    )
    soft_zone: float = _setting(
        (0.1, 0.001, 1.0, 'rad'),
        'distance from a position limit below which the bridge slows a motion towards the limit',
    )
    position_tolerance: float = _setting(
        (0.05, 0.001, 0.5, 'rad'),
        'distance beyond a position limit above which the bridge enters fault',
    )
    # At least 1, because the arm must not stop below the limit.
    velocity_factor: float = _setting(
        (1.25, 1.0, 5.0, ''),
        'measured or commanded joint speed above which the bridge enters fault, as a multiple '
        'of the velocity limit',
    )
    effort_factor: float = _setting(
        (2.0, 1.0, 5.0, ''),
        'commanded joint torque above which the bridge enters fault, as a multiple of the '
        'effort limit',
    )
    position_error_max: float = _setting(
        (0.5, 0.01, 2.0, 'rad'),
        'distance between position reference and joint position above which the bridge enters '
        'fault',
    )
    # 100 Hz
    velocity_lag: float = _setting(
        (1.59e-3, 1e-5, 0.02, 's'),
        "time constant of the low-pass filter in the boards' velocity estimate",
    )
    current_lag: float = _setting(
        (0.19e-3, 1e-6, 0.05, 's'),
        "time constant of the boards' current control, for the estimate of the mean torque",
    )
    stall_time: float = _setting(
        (0.05, 0.005, 60.0, 's'),
        'time without motion above which the bridge enters fault, for a joint whose torque is '
        'large enough to move it',
    )
    ambient_temperature: float = _setting(
        (25.0, -40.0, 60.0, 'degC'),
        'temperature of the air around the motors, for the estimate of motor temperatures',
    )
    start_temperature: float = _setting(
        (60.0, -40.0, 100.0, 'degC'),
        'motor temperature that the bridge assumes at its start; set it to ambient_temperature '
        'if the motors are cold',
    )

    def __post_init__(self) -> None:
        """Validate the values; raises ValueError."""
        for item in fields(self):
            low, high = item.metadata['bounds']
            value = getattr(self, item.name)
            if not low <= value <= high:
                raise ValueError(
                    f'bridge setting {item.name} is {value}: set a value from {low:g} to {high:g}'
                )
