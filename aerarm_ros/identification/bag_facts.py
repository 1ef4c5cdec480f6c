"""What is known of a bag besides its motion."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BagFacts:
    """How a bag was used and how well it was recorded.

    Attributes
    ----------
    used : str
        Which part of it, in words.
    lost : int or None
        Joint states missing between the first and the last; None without numbers.
    missed_cycles : int or None
        Cycles the bridge missed meanwhile; None if the bag has no diagnostics.
    """

    used: str
    lost: int | None = None
    missed_cycles: int | None = None

    @property
    def text(self) -> str:
        """One line for a terminal."""
        parts = [f'used {self.used}']
        if self.lost is not None:
            parts.append(f'{self.lost} states lost')
        if self.missed_cycles is not None:
            parts.append(f'{self.missed_cycles} cycles missed')
        return ', '.join(parts)
