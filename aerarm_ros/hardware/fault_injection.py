"""Faults of the emulated boards by name, for a parameter, a service or a test."""

from collections.abc import Callable
from math import pi

from aerarm_ros.hardware.emulated_board import DRIVER_ERROR, TEMPERATURE_ERROR, EmulatedBoard
from aerarm_ros.hardware.emulated_transport import EmulatedTransport

_Injection = Callable[[EmulatedBoard, int, float], None]


class FaultInjectionError(ValueError):
    """A fault that does not exist, or a board or motor that the arm does not have."""


def inject(
    transport: EmulatedTransport,
    fault: str,
    board: int = 0,
    motor: int = 0,
    value: float | None = None,
) -> None:
    """Make something go wrong with an emulated board.

    Parameters
    ----------
    transport
        The emulated boards.
    fault
        A key of `FAULTS`.
    board, motor
        Which board, and which of its motors (0 or 1) for the faults of an encoder.
    value
        Strength of the fault, in the unit that `FAULTS` gives; its default if None.

    Raises
    ------
    FaultInjectionError
        The text lists what there is.
    """
    check(fault, len(transport.boards), board, motor)
    _, default, injection = FAULTS[fault]
    injection(transport.boards[board], motor, default if value is None else value)


def check(fault: str, boards: int, board: int = 0, motor: int = 0) -> None:
    """Raise FaultInjectionError unless there is such a fault, board and motor."""
    if fault not in FAULTS:
        raise FaultInjectionError(f'no fault {fault!r}: choose one of {", ".join(FAULTS)}')
    if not 0 <= board < boards or motor not in (0, 1):
        raise FaultInjectionError(
            f'no board {board} with motor {motor}: the arm has boards 0 to {boards - 1} with '
            'motors 0 and 1'
        )


def _bit_errors(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.bit_error_rate = value


def _lost_frames(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.lost_frame_rate = value


def _dead_board(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.cut_power()


def _stuck_encoder(board: EmulatedBoard, motor: int, _value: float) -> None:
    board.motors[motor].encoder.stuck = True


def _encoder_jump(board: EmulatedBoard, motor: int, value: float) -> None:
    board.motors[motor].encoder.jump(value)


def _over_temperature(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.raise_error(TEMPERATURE_ERROR)


def _driver_error(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.raise_error(DRIVER_ERROR)


def _board_timeout(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.faults.deaf = True


def _slow_bus(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.exchange_time = value


def _power_cycle(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.power_cycle()


# Name: (meaning, default value, how). The last one is the cure.
FAULTS: dict[str, tuple[str, float, _Injection]] = {
    'bit_errors': ('share of frames, each way, with flipped bits', 0.05, _bit_errors),
    'lost_frames': ('share of exchanges that the board misses', 0.05, _lost_frames),
    'dead_board': ('the board has no supply', 0.0, _dead_board),
    'stuck_encoder': ("a motor's count stands still", 0.0, _stuck_encoder),
    'encoder_jump': ("a motor's count jumps [rad, motor side]", pi, _encoder_jump),
    'over_temperature': ('the board reports a critical temperature', 0.0, _over_temperature),
    'driver_error': ('the gate driver reports a fault', 0.0, _driver_error),
    'board_timeout': ('the board no longer receives', 0.0, _board_timeout),
    'slow_bus': ('duration of an exchange [s]', 2e-3, _slow_bus),
    'power_cycle': ('no fault: supply off and on', 0.0, _power_cycle),
}
