"""What is known of a bag besides its motion."""

from dataclasses import dataclass

_MISSED_MAX = 0.01  # share of the bridge's cycles; single long steps are filtered away


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
    columns : str
        Columns of each joint in a table; empty for a bag.
    """

    used: str
    lost: int | None = None
    missed_cycles: int | None = None
    columns: str = ''

    @property
    def text(self) -> str:
        """One line for a terminal."""
        parts = [f'used {self.used}']
        if self.lost is not None:
            parts.append(f'{self.lost} states lost')
        if self.missed_cycles is not None:
            parts.append(f'{self.missed_cycles} cycles missed')
        columns = f'\n  columns: {self.columns}' if self.columns else ''
        return ', '.join(parts) + columns

    def warnings(self, name: str, states: int) -> list[str]:
        """Return what the user should know of how the bag was recorded.

        Parameters
        ----------
        name : str
            Of the bag.
        states : int
            Joint states in the bag, one for each cycle that was not missed.
        """
        missed = self.missed_cycles or 0
        share = missed / max(states + (self.lost or 0) + missed, 1)
        if share <= _MISSED_MAX:
            return []
        return [
            f'{name}: {100.0 * share:.2g} % of the cycles were missed: torque and velocity then '
            'belong to longer steps; give the bridge real-time priority '
            '(as in config/parameters_spi.yaml), or close what loads the computer'
        ]
