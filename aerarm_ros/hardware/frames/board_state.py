"""What one board reports in one cycle."""

from dataclasses import dataclass, field

TIMESTAMP_PERIOD = 65.536  # [s] after which a board's clock begins anew


def _pair() -> list[float]:
    return [0.0, 0.0]


def _flags() -> list[bool]:
    return [False, False]


@dataclass(slots=True)
class BoardState:
    """One sensor frame in SI units, motor side; lists hold motor 1, motor 2.

    Attributes
    ----------
    system_enabled, motor_enabled, motor_ready
        A motor is ready once it is aligned.
    index_detected, index_toggle
        The encoder's index was met since power-on; a bit that flips at each pass.
    error
        Error code of the board, 0 for none; `FrameProfile.error_text` says what it means.
    timestamp
        Clock of the board [s], wraps after 65.5 s.
    position, velocity, current
        Measured motor angle [rad], filtered speed [rad/s] and quadrature current [A].
    coil_resistance, adc
        Phase resistance [ohm] and raw analogue inputs, where the profile carries them.
    quadrature_voltage, bus_voltage
        Voltages of a motor [V], where the profile carries them.
    index
        Number of the last command that the board accepted.
    """

    system_enabled: bool = False
    motor_enabled: list[bool] = field(default_factory=_flags)
    motor_ready: list[bool] = field(default_factory=_flags)
    index_detected: list[bool] = field(default_factory=_flags)
    index_toggle: list[bool] = field(default_factory=_flags)
    error: int = 0
    timestamp: float = 0.0
    position: list[float] = field(default_factory=_pair)
    velocity: list[float] = field(default_factory=_pair)
    current: list[float] = field(default_factory=_pair)
    coil_resistance: list[float] = field(default_factory=_pair)
    adc: list[int] = field(default_factory=lambda: [0, 0])
    quadrature_voltage: list[float] = field(default_factory=_pair)
    bus_voltage: list[float] = field(default_factory=_pair)
    index: int = 0
