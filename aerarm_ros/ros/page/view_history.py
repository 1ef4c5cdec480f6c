"""The last seconds of the arm's motion, for plots."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class ViewHistory:
    """Ring buffer of joint states.

    Parameters
    ----------
    joints
        Number of joints n.
    duration
        Time kept [s].
    rate
        Samples a second.
    """

    def __init__(self, joints: int, duration: float, rate: float) -> None:
        size = max(2, int(duration * rate))
        self._duration = duration
        self._time = np.full(size, -np.inf)
        self._values = np.zeros((size, 3, joints))
        self._next = 0

    def add(self, now: float, values: Array) -> None:
        """Store position, velocity and effort, (3, n), taken at the monotonic time `now` [s]."""
        self._time[self._next] = now
        self._values[self._next] = values
        self._next = (self._next + 1) % len(self._time)

    def window(self, now: float) -> tuple[Array, Array]:
        """Return what is at most `duration` old.

        Returns
        -------
        time : (k,) before `now`, so negative, ascending [s]
        values : (k, 3, n)
        """
        order = np.roll(np.arange(len(self._time)), -self._next)
        order = order[self._time[order] >= now - self._duration]
        return self._time[order] - now, self._values[order]
