"""Notices a sensor that repeats itself while the drone moves."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class FreezeWatch:
    """Follows how long a reading has not changed by a single bit.

    Parameters
    ----------
    patience : float
        Time [s] after which a reading that stays counts as frozen, if the drone moves.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self._last: Array | None = None
        self._since = 0.0

    def is_frozen(self, reading: Array, now: float, is_moving: bool) -> bool:
        """Take a reading at `now` [s]; return whether it has stayed while the drone moved."""
        if self._last is None or not np.array_equal(reading, self._last) or not is_moving:
            self._last, self._since = reading, now
        return now - self._since > self._patience
