"""What a control law asks of the bridge."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class JointCommand(NamedTuple):
    """Command for n joints; which fields are given chooses the boards' loop.

    Effort alone is torque control, velocity alone the boards' velocity loop, and all three
    the boards' full law (4.4) with the effort as feed-forward.

    Attributes
    ----------
    position, velocity, effort : (n,) ndarray or None
        [rad], [rad/s], [Nm]
    """

    position: Array | None = None
    velocity: Array | None = None
    effort: Array | None = None
