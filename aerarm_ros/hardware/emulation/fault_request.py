"""A fault to inject, as a user writes it."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING

from aerarm_ros.hardware.emulation.fault_injection import FaultInjectionError, check, inject

if TYPE_CHECKING:  # as in fault_injection
    from aerarm_ros.hardware.emulation.emulated_transport import EmulatedTransport

FORM = 'NAME[:BOARD[:MOTOR[:VALUE]]]'


@dataclass(frozen=True)
class FaultRequest:
    """A fault with its place and strength; see `fault_injection.inject`.

    Attributes
    ----------
    name
        A key of `fault_injection.FAULTS`.
    board, motor
        Where.
    value
        How much; the fault's default if None.
    """

    name: str
    board: int = 0
    motor: int = 0
    value: float | None = None

    @classmethod
    def parse(cls, text: str, boards: int) -> FaultRequest:
        """Read NAME[:BOARD[:MOTOR[:VALUE]]] for an arm with some boards.

        Raises FaultInjectionError, which says what there is, if it makes no sense.
        """
        name, *places = text.strip().split(':')
        try:
            board, motor = (int(place) for place in [*places, '0', '0'][:2])
            value = float(places[2]) if len(places) > 2 else None
        except ValueError:
            raise FaultInjectionError(f'{text!r} is not of the form {FORM}') from None
        if len(places) > 3 or not (value is None or isfinite(value)):
            raise FaultInjectionError(f'{text!r} is not of the form {FORM}')
        check(name, boards, board, motor, value)
        return cls(name, board, motor, value)

    def apply(self, transport: EmulatedTransport) -> None:
        """Make it go wrong."""
        inject(transport, self.name, self.board, self.motor, self.value)
