"""An odometry that is not ideal."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.simulation.small_turn import turned

Array = NDArray[np.float64]
OdometryReading = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class OdometryErrors:
    """White noise of an odometry's readings, each the standard deviation of an axis.

    Attributes
    ----------
    position, velocity, attitude, rate : float
        [m], [m/s], [rad], [rad/s]
    """

    position: float = 0.0
    velocity: float = 0.0
    attitude: float = 0.0
    rate: float = 0.0


class NoisyOdometry:
    """Adds `OdometryErrors` to true readings.

    Parameters
    ----------
    errors : OdometryErrors
    seed : int
    """

    def __init__(self, errors: OdometryErrors, seed: int) -> None:
        self._errors = errors
        self._random = np.random.default_rng(seed)

    def apply(self, reading: OdometryReading) -> OdometryReading:
        """Return position, attitude (x, y, z, w), velocity and angular velocity with noise."""
        position, attitude, velocity, rate = reading
        errors, noise = self._errors, self._random.standard_normal((4, 3))
        return (
            position + errors.position * noise[0],
            turned(attitude, errors.attitude * noise[1]),
            velocity + errors.velocity * noise[2],
            rate + errors.rate * noise[3],
        )
