"""How a board aligns a motor when it is enabled."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AlignmentTiming:
    """The field that turns an unaligned rotor: one electrical turn forward, then back.

    Attributes
    ----------
    forward, reverse, hold
        Durations [s] of the turn forward, the turn back, and the rest at the end.
    current
        Current in the field's direction [A].
    """

    forward: float = 0.5
    reverse: float = 0.5
    hold: float = 0.3
    current: float = 2.0

    def __post_init__(self) -> None:
        """Check the durations; raises ValueError."""
        if min(self.forward, self.reverse, self.hold, self.current) <= 0.0:
            raise ValueError('alignment durations and current must be above 0')

    @property
    def total(self) -> float:
        """Duration of the whole alignment [s]."""
        return self.forward + self.reverse + self.hold
