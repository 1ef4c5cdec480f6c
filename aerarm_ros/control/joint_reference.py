"""What a joint-space law has to follow at one instant, thesis (2.17)."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class JointReference(NamedTuple):
    """Desired motion of n joints.

    Attributes
    ----------
    q, dq, ddq : (n,) ndarray
        q_d [rad], its velocity [rad/s] and acceleration [rad/s^2].
    """

    q: Array
    dq: Array
    ddq: Array

    @classmethod
    def at_rest(cls, q: npt.ArrayLike) -> 'JointReference':
        """Return the reference that stays at `q` (n,) [rad]."""
        position = np.array(q, dtype=float)
        return cls(position, np.zeros_like(position), np.zeros_like(position))
