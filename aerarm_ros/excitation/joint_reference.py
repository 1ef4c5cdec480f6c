"""What a motion asks of the joints at one instant, or at many."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


class JointReference(NamedTuple):
    """Position [rad], velocity [rad/s] and acceleration [rad/s^2], each (n,) or (M, n)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Motion(Protocol):
    """A motion of all joints over [0, duration]."""

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        ...

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], a scalar or (M,)."""
        ...
