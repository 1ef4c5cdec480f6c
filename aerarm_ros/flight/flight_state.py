"""Where the drone is and how it moves."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class FlightState(NamedTuple):
    """Pose and velocity of the body frame.

    Attributes
    ----------
    position, velocity : (3,) ndarray
        Of its origin in the world [m], [m/s].
    rotation : (3, 3) ndarray
        Body to world.
    rate : (3,) ndarray
        Angular velocity in body axes [rad/s].
    specific_force : (3,) ndarray, optional
        What the IMU feels where it is, in body axes [m/s^2].
    """

    position: Array
    velocity: Array
    rotation: Array
    rate: Array
    specific_force: Array | None = None
