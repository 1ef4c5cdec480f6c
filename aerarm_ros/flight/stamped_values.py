"""Values with the times that they are about."""

from bisect import bisect_right
from collections import deque

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_KEPT = 256
SET_BACK = 1.0  # [s] a stamp that far before the last is of a clock that was set back


class StampedValues:
    """The last values of a stream, to be asked for at any time between them.

    Parameters
    ----------
    hold_time : float
        How long the last value stands for what comes after it [s].
    """

    def __init__(self, hold_time: float) -> None:
        self._hold_time = hold_time
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._values: deque[Array] = deque(maxlen=_KEPT)

    @property
    def newest(self) -> float | None:
        """Time of the last value [s], None before the first."""
        return self._times[-1] if self._times else None

    def add(self, time: float, value: Array) -> None:
        """Take a value of a time [s]; one that is not newer than the last is ignored."""
        times = self._times
        if times and time <= times[-1]:
            if time > times[-1] - SET_BACK:
                return
            times.clear()
            self._values.clear()
        times.append(time)
        self._values.append(value)

    def between(self, time: float) -> Array | None:
        """Return the value at a time [s], None if it does not lie between two."""
        times = self._times
        return self.at(time) if times and times[0] <= time <= times[-1] else None

    def at(self, time: float) -> Array | None:
        """Return the value at a time [s], straight between two; None if it is not known."""
        times, values = self._times, self._values
        if not times or time > times[-1] + self._hold_time:
            return None
        after = bisect_right(times, time)
        if after == len(times):
            return values[-1]
        if after == 0:
            return values[0] if time > times[0] - self._hold_time else None
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return values[after - 1] + share * (values[after] - values[after - 1])
