"""What a controller knows about the arm at one instant."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class ArmState(NamedTuple):
    """Measured state of n joints.

    Attributes
    ----------
    q, dq : (n,) ndarray
        Position [rad] and velocity [rad/s].
    tau : (n,) ndarray
        Torque of the drives at the joints [Nm], from the motor currents.
    """

    q: Array
    dq: Array
    tau: Array
