"""What a Cartesian law has to follow at one instant."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class TaskReference(NamedTuple):
    """Desired motion of a frame's origin, in the base frame.

    Attributes
    ----------
    p, dp, ddp : (3,) ndarray
        p_d [m], its velocity [m/s] and acceleration [m/s^2].
    """

    p: Array
    dp: Array
    ddp: Array
