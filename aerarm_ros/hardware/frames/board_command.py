"""What the master tells one board in one cycle."""

from dataclasses import dataclass, field


def _pair(value: float = 0.0) -> list[float]:
    return [value, value]


def _flags() -> list[bool]:
    return [False, False]


@dataclass(slots=True)
class BoardCommand:
    """One command frame in SI units, motor side; lists hold motor 1, motor 2.

    The board computes ``iq = kp (position - theta) + kd (velocity - omega) + current``
    (thesis (4.4)) and saturates it. A frame profile with an integral gain adds
    ``integral_gain`` times the integral of the position error, as the thesis prints it.

    Attributes
    ----------
    enable_system, enable_motor
        A motor is driven only if both are set. Setting them aligns the motor, which moves it.
    position_rollover_error
        Let the board stop with an error when a position leaves the field's range.
    index_offset_compensation
        Let a position jump to the encoder's index when the index is met: for homing only.
    timeout
        Time without a valid frame after which the board stops [s]; never 0.
    position, velocity, current
        References [rad], [rad/s] and feed-forward current [A].
    kp, kd, integral_gain
        Gains [A/rad], [A s/rad], [A/(rad s)].
    current_saturation
        Largest current the law may ask for [A]; never 0.
    index
        Number of the command modulo 65536, echoed by the board.
    """

    enable_system: bool = False
    enable_motor: list[bool] = field(default_factory=_flags)
    position_rollover_error: bool = True
    index_offset_compensation: list[bool] = field(default_factory=_flags)
    timeout: float = 0.02
    position: list[float] = field(default_factory=_pair)
    velocity: list[float] = field(default_factory=_pair)
    current: list[float] = field(default_factory=_pair)
    kp: list[float] = field(default_factory=_pair)
    kd: list[float] = field(default_factory=_pair)
    integral_gain: list[float] = field(default_factory=_pair)
    current_saturation: list[float] = field(default_factory=lambda: [1.0, 1.0])
    index: int = 0
