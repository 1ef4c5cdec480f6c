"""Times and tolerances of the bridge that parameters can change."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import ClassVar


@dataclass(frozen=True)
class BridgeSettings:
    """Times and tolerances of the bridge; each value has bounds.

    Attributes
    ----------
    period
        Time between two cycles [s].
    command_timeout
        Time without an accepted command after which the arm is damped [s].
    stamp_age_max
        Largest age of the state to which a command responds [s].
    board_timeout
        Time without a valid frame after which a board switches its motors off [s].
    bad_frames_max
        Number of consecutive bad answers of a board at which a fault stops the arm.
    lost_commands_max
        Number of consecutive commands, lost on the way to a board that still answers, at which a
        fault stops the arm.
    lost_commands_warning
        Fraction of commands lost in this way, over the last second, above which a warning appears.
    state_age_max
        Time [s] after which identical data in all valid answers of a board are a fault.
    exchange_time_max, slow_exchanges_max
        Duration above which an exchange counts as slow [s], and number of consecutive slow
        exchanges at which a fault stops the arm.
    connect_frames
        Number of consecutive valid frames after which a board counts as connected.
    alignment_timeout
        Longest time a board may take to align its motors [s].
    soft_zone
        Distance from a position limit [rad] within which the allowed speed towards the limit
        falls from the velocity limit to zero; longer if braking needs a longer distance.
    position_tolerance
        Distance beyond a position limit at which the arm is stopped [rad].
    velocity_factor, effort_factor
        The arm is stopped if a velocity or effort exceeds its limit by this factor.
    position_error_max
        Distance between position reference and arm at which the arm is stopped [rad].
    velocity_lag
        Time constant of the boards' low-pass filter of the motor speeds [s].
    current_lag
        Time constant of the boards' current loop [s], used to compute the mean torque of a cycle.
    stall_time
        Time [s] after which a joint that stands still under a torque that must move it is a
        fault.
    ambient_temperature
        Temperature of the air around the motors [degC].
    start_temperature
        Assumed temperature of the motors when the bridge starts [degC].
    BOUNDS
        Smallest and largest allowed value of each setting, by the setting's name.
    """

    # The ranges are wide enough for another light arm, a busy host or a slow bus, and narrow
    # enough that each stop still occurs when needed.
    BOUNDS: ClassVar[Mapping[str, tuple[float, float]]] = MappingProxyType(
        {
            # The barriers' load observer needs states at least this often.
            'period': (0.0005, 0.004),
            'command_timeout': (0.002, 1.0),
            'stamp_age_max': (0.002, 1.0),
            'board_timeout': (0.001, 0.255),  # one byte in the frame; 0 would mean no time-out
            'bad_frames_max': (1, 1000),
            'lost_commands_max': (1, 1000),
            'lost_commands_warning': (0.001, 1.0),
            'state_age_max': (0.002, 1.0),
            'exchange_time_max': (2e-5, 0.1),
            'slow_exchanges_max': (1, 1000),
            'connect_frames': (1, 1000),
            'alignment_timeout': (0.1, 60.0),
            'soft_zone': (0.001, 1.0),
            'position_tolerance': (0.001, 0.5),
            # at least 1, because the arm must not stop below the limit
            'velocity_factor': (1.0, 5.0),
            'effort_factor': (1.0, 5.0),
            'position_error_max': (0.01, 2.0),
            'velocity_lag': (1e-5, 0.02),
            'current_lag': (1e-6, 0.05),
            'stall_time': (0.005, 60.0),
            'ambient_temperature': (-40.0, 60.0),
            'start_temperature': (-40.0, 100.0),
        }
    )

    period: float = 1e-3
    command_timeout: float = 0.05
    stamp_age_max: float = 0.05
    board_timeout: float = 0.04  # decision 32
    bad_frames_max: int = 10
    lost_commands_max: int = 10
    lost_commands_warning: float = 0.01
    state_age_max: float = 0.02
    exchange_time_max: float = 0.5e-3
    slow_exchanges_max: int = 10
    connect_frames: int = 5
    alignment_timeout: float = 6.0
    soft_zone: float = 0.1
    position_tolerance: float = 0.05
    velocity_factor: float = 1.25
    effort_factor: float = 2.0
    position_error_max: float = 0.5
    velocity_lag: float = 1.59e-3  # 100 Hz
    current_lag: float = 0.19e-3
    stall_time: float = 0.05
    ambient_temperature: float = 25.0
    start_temperature: float = 60.0

    def __post_init__(self) -> None:
        """Validate the values; raises ValueError."""
        for item in fields(self):
            low, high = self.BOUNDS[item.name]
            value = getattr(self, item.name)
            if not low <= value <= high:
                raise ValueError(
                    f'bridge setting {item.name} is {value}: set a value from {low:g} to {high:g}'
                )
