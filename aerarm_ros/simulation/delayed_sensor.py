"""A sensor with a rate of its own, whose readings come late."""

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Reading = TypeVar('Reading')


class DelayedSensor(Generic[Reading]):
    """Reads at equal intervals, and gives each reading out a delay later.

    Parameters
    ----------
    read : callable
        Returns what the sensor sees now, its errors included.
    rate : float
        Readings a second [Hz].
    cycle : float
        Time between two calls of `update` [s]; the interval is a whole number of them.
    delay : float
        Age of a reading when it is given out [s], rounded to whole cycles.

    Attributes
    ----------
    period_ns : int
        From reading to reading [ns].
    """

    def __init__(
        self, read: Callable[[], Reading], rate: float, cycle: float, delay: float = 0.0
    ) -> None:
        self._read = read
        self._cycles = max(1, round(1.0 / (rate * cycle)))
        self._delay = round(delay / cycle)
        self.period_ns = self._cycles * round(cycle * 1e9)
        self._count = 0
        self._under_way: deque[tuple[int, int, Reading]] = deque()

    def restart(self) -> None:
        """Read in the next cycle, and forget what is under way."""
        self._count = 0
        self._under_way.clear()

    def update(self, stamp_ns: int) -> tuple[int, Reading] | None:
        """Advance by a cycle that begins at `stamp_ns` [ns].

        Returns
        -------
        tuple or None
            Stamp [ns] and content of a reading, if one arrives in this cycle.
        """
        if self._count % self._cycles == 0:
            self._under_way.append((self._count + self._delay, stamp_ns, self._read()))
        arrives = bool(self._under_way) and self._under_way[0][0] <= self._count
        self._count += 1
        return self._under_way.popleft()[1:] if arrives else None
