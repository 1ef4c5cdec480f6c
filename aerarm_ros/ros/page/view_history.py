"""The last seconds of what the page plots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ViewHistory:
    """Ring buffer of arrays of one shape.

    Parameters
    ----------
    shape
        Of what is kept each time.
    duration
        Time kept [s].
    rate
        Samples a second.
    """

    def __init__(self, shape: tuple[int, ...], duration: float, rate: float) -> None:
        size = max(2, int(duration * rate))
        self._duration = duration
        self._time = np.full(size, -np.inf)
        self._values = np.zeros((size, *shape))
        self._next = 0

    def add(self, now: float, values: Array) -> None:
        """Store values of the shape given, taken at the monotonic time `now` [s]."""
        self._time[self._next] = now
        self._values[self._next] = values
        self._next = (self._next + 1) % len(self._time)

    def window(self, now: float) -> tuple[Array, Array]:
        """Return what is at most `duration` old.

        Returns
        -------
        time : (k,) before `now`, so negative, ascending [s]
        values : (k, *shape)
        """
        order = np.roll(np.arange(len(self._time)), -self._next)
        order = order[self._time[order] >= now - self._duration]
        return self._time[order] - now, self._values[order]
