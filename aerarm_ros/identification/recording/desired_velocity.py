"""What was commanded while a bag was recorded."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DesiredVelocity:
    """Commanded joint velocities of a bag.

    Attributes
    ----------
    time : (K,) ndarray
        [s] since the bag's beginning, increasing.
    dq : (K, n) ndarray
        [rad/s]
    """

    time: Array
    dq: Array
