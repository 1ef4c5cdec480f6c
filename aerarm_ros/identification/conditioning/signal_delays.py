"""By how much recorded signals of a joint come late."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SignalDelays:
    """Delays against the positions of the same message, which are the reference of time.

    Attributes
    ----------
    velocity, effort : (n,) ndarray
        [s], positive where the signal is late.
    """

    velocity: Array
    effort: Array

    @classmethod
    def none(cls, n: int) -> 'SignalDelays':
        """Return delays of zero for n joints."""
        return cls(np.zeros(n), np.zeros(n))
