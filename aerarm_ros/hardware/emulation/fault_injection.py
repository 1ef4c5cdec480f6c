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


Apply = Callable[['EmulatedBoard', int, float], None]


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
    apply: Apply
    default: float | None = None
    least: float = -inf
    most: float = inf


class FaultInjectionError(ValueError):
    """Error: a requested fault is unknown or invalid, or its board or motor does not exist."""


def _fault(name: str, strength: Callable[[float], object] = float) -> Apply:
    """Return a function that sets an attribute of the board's faults to a strength."""
    return lambda board, _, value: setattr(board.faults, name, strength(value))


def _wiring(name: str) -> Apply:
    """Return a function that sets a wiring error of a motor."""

    def apply(board: EmulatedBoard, motor: int, value: float) -> None:
        getattr(board.wiring, name)[motor] = value
        board.rewire()

    return apply


def _supply(name: str) -> Apply:
    """Return a function that sets an attribute of the board's supply."""
    return lambda board, _, value: setattr(board.supply, name, value)


def _stuck_encoder(board: EmulatedBoard, motor: int, _value: float) -> None:
    board.motors[motor].encoder.stuck = True


def _swapped_channels(board: EmulatedBoard, _motor: int, _value: float) -> None:
    board.wiring.swapped = not board.wiring.swapped
    board.rewire()


def _wrong_sign(board: EmulatedBoard, motor: int, _value: float) -> None:
    board.wiring.direction[motor] *= -1.0
    board.rewire()


_SHARE_OF_FRAMES = (0.05, 0.0, 1.0)

# The last entry of the table clears all other faults.
FAULTS: dict[str, Fault] = {
    'bit_errors': Fault(
        'fraction of frames with flipped bits, in each direction',
        _fault('bit_error_rate'),
        *_SHARE_OF_FRAMES,
    ),
    'lost_frames': Fault(
        'fraction of frame exchanges that the board misses',
        _fault('lost_frame_rate'),
        *_SHARE_OF_FRAMES,
    ),
    'lost_commands': Fault(
        'fraction of commands that the board does not receive while it answers',
        _fault('lost_command_rate'),
        *_SHARE_OF_FRAMES,
    ),
    'dead_board': Fault('the board has no supply', lambda board, _, __: board.cut_power()),
    'stuck_encoder': Fault("a motor's encoder count stops changing", _stuck_encoder),
    'encoder_jump': Fault(
        "a motor's encoder count jumps [rad, motor side]",
        lambda board, motor, value: board.motors[motor].encoder.jump(value),
        pi,
    ),
    'over_temperature': Fault(
        'the board reports a critical temperature',
        lambda board, _, __: board.raise_error(board.TEMPERATURE_ERROR),
    ),
    'warm_motor': Fault(
        'temperature of winding and housing of a motor [degC]',
        lambda board, motor, value: board.motors[motor].heat.warm(value),
        90.0,
        -40.0,
        250.0,
    ),
    'supply_voltage': Fault('supply voltage of the board [V]', _supply('source'), 16.0, 1.0, 100.0),
    'no_sink': Fault(
        "the supply accepts no braking current; VALUE is the board's capacitance [F]",
        _supply('capacitance'),
        *(2e-3, 1e-5, 1.0),
    ),
    'driver_error': Fault(
        'the gate driver reports a fault',
        lambda board, _, __: board.raise_error(board.DRIVER_ERROR),
    ),
    'board_timeout': Fault('the board receives no frames', _fault('deaf', lambda _: True)),
    'mute_board': Fault('the board receives frames but sends none', _fault('mute', lambda _: True)),
    'short_answers': Fault(
        'number of bytes of each answer that reach the host', _fault('answer_bytes', int), 20, 0, 34
    ),
    'slow_bus': Fault('duration of a frame exchange [s]', _fault('exchange_time'), 2e-3, 0.0, 1.0),
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
        'motor turns per joint turn of the installed gear', _wiring('reduction'), 27.0, 1.0, 1e4
    ),
    'weak_driver': Fault(
        'fraction of the requested current that a motor receives',
        _wiring('delivery'),
        0.5,
        0.0,
        1.0,
    ),
    'high_friction': Fault(
        "factor by which the dry friction of a motor's joint changes",
        _wiring('friction'),
        5.0,
        0.0,
        100.0,
    ),
    'power_cycle': Fault(
        'end all faults of the board and switch its supply off and on',
        lambda board, _, __: board.power_cycle(),
    ),
}


FORM = 'NAME[:BOARD[:MOTOR[:VALUE]]]'


@dataclass(frozen=True)
class FaultRequest:
    """Request to inject a fault of a given strength into a board or motor of an emulated arm.

    Attributes
    ----------
    name
        Key of `fault_injection.FAULTS`.
    board, motor
        Board number, and motor number (0 or 1) for faults of one motor.
    value
        Strength in the unit given by `FAULTS`; None for the fault's default.
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
        request = cls(name, board, motor, value)
        request.check(boards)
        return request

    def check(self, boards: int) -> None:
        """Raise FaultInjectionError if the fault, board, motor or strength is invalid.

        Parameters
        ----------
        boards
            Number of boards of the arm.
        """
        name, value = self.name, self.value
        if name not in FAULTS:
            raise FaultInjectionError(f'unknown fault {name!r}: choose one of {", ".join(FAULTS)}')
        if not 0 <= self.board < boards or self.motor not in (0, 1):
            raise FaultInjectionError(
                f'unknown board {self.board} or motor {self.motor}: the arm has boards 0 to '
                f'{boards - 1} with motors 0 and 1'
            )
        if value is None:
            return
        _, _, default, least, most = FAULTS[name]
        if default is None:
            raise FaultInjectionError(f'{name} takes no VALUE, but {value:g} was given: remove it')
        if not least <= value <= most:
            raise FaultInjectionError(
                f'value {value:g} of {name} must lie in {least:g} .. {most:g}'
            )

    def apply(self, transport: EmulatedTransport) -> None:
        """Inject the requested fault into its board, or raise FaultInjectionError."""
        self.check(len(transport.boards))
        fault = FAULTS[self.name]
        strength = fault.default if self.value is None else self.value
        fault.apply(transport.boards[self.board], self.motor, strength or 0.0)
