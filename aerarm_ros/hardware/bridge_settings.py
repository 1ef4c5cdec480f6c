"""Tunable numbers of the bridge."""

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class BridgeSettings:
    """Times and tolerances of the bridge; all must be above 0.

    Attributes
    ----------
    command_timeout
        Age of the last accepted command, since its receipt, at which the arm is damped [s].
    stamp_age_max
        Largest age of the state that a command answers [s].
    board_timeout
        Time without a valid frame after which a board switches its motors off [s].
    bad_frames_max
        Consecutive bad frames of a board that are a fault.
    state_age_max
        Age of a board's last good or last changed state that is a fault [s].
    exchange_time_max, slow_exchanges_max
        Duration of an exchange that counts as slow [s]; consecutive ones that are a fault.
    connect_frames
        Consecutive good frames after which a board counts as connected.
    alignment_timeout
        Longest time a board may take to align its motors [s].
    soft_zone
        Distance from a position limit at which motion towards it starts to be slowed [rad].
    position_tolerance
        Distance beyond a position limit at which the arm is stopped [rad].
    velocity_factor, effort_factor
        Multiples of the velocity and effort limits at which the arm is stopped.
    position_error_max
        Distance of a position reference from the arm at which the arm is stopped [rad].
    current_lag
        Time constant of the boards' current loop, for the mean torque of a cycle [s].
    stall_time
        Standstill under a torque that must move the joint that is a fault [s].
    """

    command_timeout: float = 0.05
    stamp_age_max: float = 0.05
    board_timeout: float = 0.02
    bad_frames_max: int = 10
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
    current_lag: float = 0.19e-3
    stall_time: float = 0.05

    def __post_init__(self) -> None:
        """Check the numbers; raises ValueError."""
        for item in fields(self):
            value = getattr(self, item.name)
            if not 0.0 < value < float('inf'):
                raise ValueError(f'bridge setting {item.name} is {value}, must be above 0')
        if not 0.001 <= self.board_timeout <= 0.255:
            raise ValueError(
                f'bridge setting board_timeout is {self.board_timeout} s, must lie in 0.001 to '
                '0.255 s, the range of its byte in the frame; 0 would mean never'
            )
        for name in ('velocity_factor', 'effort_factor'):
            if getattr(self, name) < 1.0:
                raise ValueError(f'bridge setting {name} is below 1: limits come before stops')
