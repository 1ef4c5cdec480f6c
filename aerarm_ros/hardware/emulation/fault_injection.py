"""Faults that can be injected into emulated boards by name, in parameters and services."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import TYPE_CHECKING, NamedTuple

# imported only for annotations, so that listing the faults loads neither boards nor physics
# engine
if TYPE_CHECKING:
    from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard
    from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport


class Fault(NamedTuple):
    """Fault that can be injected into an emulated board.

    Attributes
    ----------
    meaning
        Description of the fault, with the unit of its strength.
    apply
        Function that applies the fault with a strength to a board and a motor.
    default, least, most
        Default strength and its bounds; None for a fault without strength.
    """

    meaning: str
    apply: Callable[[EmulatedBoard, int, float], None]
    default: float | None = None
    least: float = -inf
    most: float = inf


class FaultInjectionError(ValueError):
    """Error: a requested fault is unknown or invalid, or its board or motor does not exist."""


def inject(
    transport: EmulatedTransport,
    fault: str,
    board: int = 0,
    motor: int = 0,
    value: float | None = None,
) -> None:
    """Inject a fault into an emulated board.

    Parameters
    ----------
    fault
        Key of `FAULTS`.
    board, motor
        Board number, and motor number (0 or 1) for encoder faults.
    value
        Strength of the fault in the unit given by `FAULTS`; None for the default.

    Raises
    ------
    FaultInjectionError
        If the fault, board, motor or strength is invalid; the text lists valid values.
    """
    check(fault, len(transport.boards), board, motor, value)
    strength = FAULTS[fault].default if value is None else value
    FAULTS[fault].apply(transport.boards[board], motor, strength or 0.0)


def check(
    fault: str, boards: int, board: int = 0, motor: int = 0, value: float | None = None
) -> None:
    """Raise FaultInjectionError if the fault, board, motor or strength is invalid."""
    if fault not in FAULTS:
        raise FaultInjectionError(f'unknown fault {fault!r}: choose one of {", ".join(FAULTS)}')
    if not 0 <= board < boards or motor not in (0, 1):
        raise FaultInjectionError(
            f'unknown board {board} or motor {motor}: the arm has boards 0 to {boards - 1} with '
            'motors 0 and 1'
        )
    if value is None:
        return
    _, _, default, least, most = FAULTS[fault]
    if default is None:
        raise FaultInjectionError(f'{fault} takes no VALUE, but {value:g} was given: remove it')
    if not least <= value <= most:
        raise FaultInjectionError(f'value {value:g} of {fault} must lie in {least:g} .. {most:g}')


def _bit_errors(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.bit_error_rate = value


def _lost_frames(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.lost_frame_rate = value


def _lost_commands(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.lost_command_rate = value


def _dead_board(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.cut_power()


def _stuck_encoder(board: EmulatedBoard, motor: int, _value: float) -> None:
    board.motors[motor].encoder.stuck = True


def _encoder_jump(board: EmulatedBoard, motor: int, value: float) -> None:
    board.motors[motor].encoder.jump(value)


def _over_temperature(board: EmulatedBoard, _motor: int, _value: float) -> None:
    from aerarm_ros.hardware.emulation.emulated_board import TEMPERATURE_ERROR

    board.raise_error(TEMPERATURE_ERROR)


def _warm_motor(board: EmulatedBoard, motor: int, value: float) -> None:
    board.motors[motor].heat.warm(value)


def _supply_voltage(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.supply.source = value


def _no_sink(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.supply.capacitance = value


def _driver_error(board: EmulatedBoard, _motor: int, _value: float) -> None:
    from aerarm_ros.hardware.emulation.emulated_board import DRIVER_ERROR

    board.raise_error(DRIVER_ERROR)


def _board_timeout(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.faults.deaf = True


def _mute_board(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.faults.mute = True


def _short_answers(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.answer_bytes = int(value)


def _slow_bus(board: EmulatedBoard, _motor: int, value: float) -> None:
    board.faults.exchange_time = value


def _power_cycle(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.power_cycle()


def _swapped_channels(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.wiring.swapped = not board.wiring.swapped
    board.rewire()


def _wrong_sign(board: EmulatedBoard, motor: int, _value: float) -> None:
    board.wiring.direction[motor] *= -1.0
    board.rewire()


def _wrong_ratio(board: EmulatedBoard, motor: int, value: float) -> None:
    board.wiring.reduction[motor] = value
    board.rewire()


def _weak_driver(board: EmulatedBoard, motor: int, value: float) -> None:
    board.wiring.delivery[motor] = value
    board.rewire()


def _high_friction(board: EmulatedBoard, motor: int, value: float) -> None:
    board.wiring.friction[motor] = value
    board.rewire()


_SHARE_OF_FRAMES = (0.05, 0.0, 1.0)

# The last entry of the table clears all other faults.
FAULTS: dict[str, Fault] = {
    'bit_errors': Fault(
        'fraction of frames with flipped bits, in each direction', _bit_errors, *_SHARE_OF_FRAMES
    ),
    'lost_frames': Fault(
        'fraction of frame exchanges that the board misses', _lost_frames, *_SHARE_OF_FRAMES
    ),
    'lost_commands': Fault(
        'fraction of commands that the board does not receive while it answers',
        _lost_commands,
        *_SHARE_OF_FRAMES,
    ),
    'dead_board': Fault('the board has no supply', _dead_board),
    'stuck_encoder': Fault("a motor's encoder count stops changing", _stuck_encoder),
    'encoder_jump': Fault("a motor's encoder count jumps [rad, motor side]", _encoder_jump, pi),
    'over_temperature': Fault('the board reports a critical temperature', _over_temperature),
    'warm_motor': Fault(
        'temperature of winding and housing of a motor [degC]', _warm_motor, 90.0, -40.0, 250.0
    ),
    'supply_voltage': Fault('supply voltage of the board [V]', _supply_voltage, 16.0, 1.0, 100.0),
    'no_sink': Fault(
        "the supply accepts no braking current; VALUE is the board's capacitance [F]",
        _no_sink,
        *(2e-3, 1e-5, 1.0),
    ),
    'driver_error': Fault('the gate driver reports a fault', _driver_error),
    'board_timeout': Fault('the board receives no frames', _board_timeout),
    'mute_board': Fault('the board receives frames but sends none', _mute_board),
    'short_answers': Fault(
        'number of bytes of each answer that reach the host', _short_answers, 20, 0, 34
    ),
    'slow_bus': Fault('duration of a frame exchange [s]', _slow_bus, 2e-3, 0.0, 1.0),
    'swapped_channels': Fault(
        "the board's two motors, with their encoders, are swapped; inject the fault again "
        'to swap them back',
        _swapped_channels,
    ),
    'wrong_sign': Fault(
        'a motor turns its joint in the wrong direction; inject the fault again to end it',
        _wrong_sign,
    ),
    'wrong_ratio': Fault(
        'motor turns per joint turn of the installed gear', _wrong_ratio, 27.0, 1.0, 1e4
    ),
    'weak_driver': Fault(
        'fraction of the requested current that a motor receives', _weak_driver, 0.5, 0.0, 1.0
    ),
    'high_friction': Fault(
        "factor by which the dry friction of a motor's joint changes",
        _high_friction,
        5.0,
        0.0,
        100.0,
    ),
    'power_cycle': Fault(
        'end all faults of the board and switch its supply off and on', _power_cycle
    ),
}


if TYPE_CHECKING:  # see fault_injection
    from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport

FORM = 'NAME[:BOARD[:MOTOR[:VALUE]]]'


@dataclass(frozen=True)
class FaultRequest:
    """Request to inject a fault of a given strength into a board or motor; see `inject`.

    Attributes
    ----------
    name
        Key of `fault_injection.FAULTS`.
    board, motor
        Board and motor number.
    value
        Strength; None for the fault's default.
    """

    name: str
    board: int = 0
    motor: int = 0
    value: float | None = None

    @classmethod
    def parse(cls, text: str, boards: int) -> FaultRequest:
        """Parse a fault request NAME[:BOARD[:MOTOR[:VALUE]]].

        Raises FaultInjectionError, which lists valid values, for an invalid text.
        """
        name, *places = text.strip().split(':')
        try:
            board, motor = (int(place) for place in [*places, '0', '0'][:2])
            value = float(places[2]) if len(places) > 2 else None
        except ValueError:
            raise FaultInjectionError(f'{text!r} must have the form {FORM}') from None
        if len(places) > 3 or not (value is None or isfinite(value)):
            raise FaultInjectionError(f'{text!r} must have the form {FORM}')
        check(name, boards, board, motor, value)
        return cls(name, board, motor, value)

    def apply(self, transport: EmulatedTransport) -> None:
        """Inject the requested fault into its board."""
        inject(transport, self.name, self.board, self.motor, self.value)
