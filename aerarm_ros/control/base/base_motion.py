"""How the arm's base moves, as far as the arm feels it."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class BaseMotion(NamedTuple):
    """Motion of the base frame at its origin, all in base axes.

    Attributes
    ----------
    gravity : (3,) ndarray
        Gravity [m/s^2].
    specific_force : (3,) ndarray
        Acceleration of the base's origin minus gravity [m/s^2]: what an accelerometer there
        reads. At rest it is `-gravity`.
    angular_velocity, angular_acceleration : (3,) ndarray
        [rad/s], [rad/s^2]
    """

    gravity: Array
    specific_force: Array
    angular_velocity: Array
    angular_acceleration: Array

    @classmethod
    def still(cls, gravity_in_base: npt.ArrayLike) -> 'BaseMotion':
        """Return a base at rest (or in steady translation) under `gravity_in_base` [m/s^2]."""
        gravity = np.array(gravity_in_base, dtype=float)
        return cls(gravity, -gravity, np.zeros(3), np.zeros(3))
