"""What an optimiser passes on its way, in case it does not arrive."""

from __future__ import annotations

from aerarm_ros.motion.float_array import FloatArray


class FeasibleIterates:
    """Keeps the iterates that seem feasible.

    An optimiser may be stopped, and its optimum may break a limit between the samples it looked
    at. Iterates before it are nearly as good, and often inside.
    """

    _TOLERANCE = 1e-3
    """Violation of the constraints, which overestimate, that may still be feasible."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, int, FloatArray]] = []
        self._count = 0
        self.last: FloatArray | None = None
        """The latest iterate, feasible or not."""

    def see(self, x: FloatArray, value: float, constraints: FloatArray) -> None:
        """Take note of an iterate.

        Parameters
        ----------
        x : the iterate.
        value : its objective, smaller is better.
        constraints : >= 0 where feasible.
        """
        self._count += 1
        self.last = x.copy()
        if constraints.min(initial=0.0) >= -self._TOLERANCE:
            self._seen.append((value, self._count, self.last))

    def best(self, number: int = 12) -> list[tuple[FloatArray, int]]:
        """Return up to `number` iterates, best first, and after how many steps each was met.

        Neighbours on the way to an optimum share what is wrong with it, so they are spread over
        all iterates: the very best, then those that are better than all but 2, 4, 8... others.
        """
        ranked = sorted(self._seen, key=lambda item: item[:2])
        chosen = [0, *(2**i for i in range(number - 1))]
        return [(ranked[i][2], ranked[i][1]) for i in chosen if i < len(ranked)]
