"""Content of the SPI frames: command to a board, state of a board, and checksum (CRC)."""

import zlib
from dataclasses import dataclass, field


def _pair(value: float = 0.0) -> list[float]:
    return [value, value]


def _flags() -> list[bool]:
    return [False, False]


@dataclass(slots=True)
class BoardCommand:
    """Content of a command frame, in SI units on the motor side; lists are for motors 1 and 2.

    The board computes ``iq = kp (position - theta) + kd (velocity - omega) + current`` (thesis
    (4.4)) and saturates it. If the frame profile has an integral gain, the board adds
    ``integral_gain`` times the integral of the position error, as in the thesis.

    Attributes
    ----------
    enable_system, enable_motor
        A motor is driven only if both are set. Setting both aligns the motor, which moves it.
    position_rollover_error
        Whether the board stops with an error when a position leaves the range of its frame field.
    index_offset_compensation
        Whether the position is reset at the encoder's index pulse; the bridge does not use this,
        and emulated boards ignore it.
    timeout
        Time without a valid frame after which the board stops [s]; never 0.
    position, velocity, current
        References [rad], [rad/s] and feed-forward current [A].
    kp, kd, integral_gain
        Gains [A/rad], [A s/rad], [A/(rad s)].
    current_saturation
        Largest current that the law may request [A]; never 0.
    index
        Number of the command modulo 65536; the board echoes it.
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


TIMESTAMP_PERIOD = 65.536  # [s] after which a board's clock wraps


@dataclass(slots=True)
class BoardState:
    """Content of a sensor frame, in SI units on the motor side; lists are for motors 1 and 2.

    Attributes
    ----------
    system_enabled, motor_enabled, motor_ready
        Whether the board is enabled, and whether each motor is enabled and ready (aligned).
    index_detected, index_toggle
        Whether the encoder has detected an index pulse since power-on, and a bit that flips at
        each pulse.
    error
        Error code of the board, 0 for none; see `FrameProfile.error_text`.
    timestamp
        Clock of the board [s]; it wraps after 65.5 s.
    position, velocity, current
        Measured motor angle [rad], filtered speed [rad/s] and quadrature current [A].
    coil_resistance, adc
        Phase resistance [ohm] and raw analogue inputs, if the profile contains them.
    quadrature_voltage, bus_voltage
        Quadrature voltage and supply voltage [V], if the profile contains them.
    index
        Number of the last command that the board accepted before this answer.
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


_MASK = 0xFFFFFFFF
_BIT_REVERSED = bytes(int(f'{byte:08b}'[::-1], 2) for byte in range(256))


def crc32_mpeg2(data: bytes) -> bytes:
    """Return the checksum CRC-32/MPEG-2 of bytes: polynomial 0x04C11DB7, initial value all ones.

    The CRC-32 of zlib uses the same polynomial and initial value, but processes the bits of each
    byte in reverse order and inverts the result. Reversing the bits before and after it therefore
    gives this CRC at the speed of compiled code.

    Returns
    -------
    bytes
        Check value, four bytes, the most significant first.
    """
    reflected = zlib.crc32(data.translate(_BIT_REVERSED)) ^ _MASK
    return reflected.to_bytes(4, 'little').translate(_BIT_REVERSED)
