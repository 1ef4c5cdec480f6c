"""The content of one JointState message as numbers."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class JointSample(NamedTuple):
    """One JointState without its names, in the joint order of whoever made it.

    Attributes
    ----------
    stamp_ns
        `header.stamp` [ns].
    position, velocity, effort
        (n,) [rad], [rad/s], [Nm]; None where the message leaves the field empty.
    """

    stamp_ns: int
    position: NDArray[np.float64] | None
    velocity: NDArray[np.float64] | None
    effort: NDArray[np.float64] | None
