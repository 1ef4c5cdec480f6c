"""Means over short stretches of a motor bench's run."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotorBlocks:
    """Mean motion and torque of a joint in each of B blocks of time.

    Attributes
    ----------
    speed : float or None
        Commanded velocity, signed [rad/s].
    sine, cosine : (B,) ndarray
        Means of sin(q) and cos(q), which gravity's torque is made of [-].
    dq, ddq, tau : (B,) ndarray
        [rad/s], [rad/s^2], [Nm], at the joint.
    """

    speed: float | None
    sine: Array
    cosine: Array
    dq: Array
    ddq: Array
    tau: Array
