"""How an emulated arm was built, where it differs from its configuration."""

from __future__ import annotations

from dataclasses import dataclass, field


def _of_both(value: float) -> list[float]:
    return [value, value]


@dataclass(slots=True)
class BoardWiring:
    """Errors made at the bench, of one board and its two motors; none by default.

    They last: no power cycle mends a cable. Lists have one entry per channel.

    Attributes
    ----------
    swapped
        Whether the two motors, with their encoders, are plugged into each other's channel.
    direction
        -1 for a motor that turns its joint against the configuration's sign, else 1.
    reduction
        Motor turns per joint turn; 0 for the configuration's.
    delivery
        Share of the requested current that the driver delivers. Its measurement is right.
    friction
        Factor of the dry friction of the joint that the motor drives.
    """

    swapped: bool = False
    direction: list[float] = field(default_factory=lambda: _of_both(1.0))
    reduction: list[float] = field(default_factory=lambda: _of_both(0.0))
    delivery: list[float] = field(default_factory=lambda: _of_both(1.0))
    friction: list[float] = field(default_factory=lambda: _of_both(1.0))
