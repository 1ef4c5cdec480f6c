"""Integral action with a limit."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import non_negative

Array = npt.NDArray[np.float64]


class ErrorIntegral:
    """`Ki` times the integral of the error, held within plus and minus `limit`.

    The limit is what keeps a blocked or saturated joint from winding up.

    Parameters
    ----------
    gain : (n,) array_like
        Ki, in the output's unit per [rad s].
    limit : (n,) array_like
        Largest output, in its own unit.

    Raises
    ------
    ValueError
        If a value is negative or the lengths differ.
    """

    def __init__(self, gain: npt.ArrayLike, limit: npt.ArrayLike) -> None:
        n = np.size(gain)
        self._gain = non_negative('integral gain', gain, n)
        self._limit = non_negative('integral limit', limit, n)
        self._value = np.zeros(n)

    def reset(self) -> None:
        """Start again from zero."""
        self._value = np.zeros_like(self._value)

    def update(self, error: Array, dt: float) -> Array:
        """Add `error` (n,) [rad] over `dt` [s] and return the output (n,)."""
        value = self._value + (dt * self._gain) * error
        self._value = np.minimum(np.maximum(value, -self._limit), self._limit)
        return self._value
