"""An IMU that is not ideal."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.simulation.random_drift import RandomDrift
from aerarm_ros.simulation.small_turn import turned

Array = NDArray[np.float64]
ImuReading = tuple[Array, Array, Array]

_ATTITUDE_TIME = 10.0  # [s] correlation time of an attitude filter's error


@dataclass(frozen=True)
class ImuErrors:
    """Deviations of an IMU, each the standard deviation of an axis.

    Attributes
    ----------
    force_noise, rate_noise : float
        White noise of a sample [m/s^2], [rad/s].
    force_bias, rate_bias : float
        What stays constant [m/s^2], [rad/s].
    attitude : float
        Slowly changing error of the attitude [rad].
    """

    force_noise: float = 0.0
    rate_noise: float = 0.0
    force_bias: float = 0.0
    rate_bias: float = 0.0
    attitude: float = 0.0


class FaultyImu:
    """Adds `ImuErrors` to ideal readings.

    Parameters
    ----------
    errors : ImuErrors
    period : float
        Between readings [s].
    seed : int
    """

    def __init__(self, errors: ImuErrors, period: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        self._errors = errors
        self._random = random
        self._force_bias = errors.force_bias * random.standard_normal(3)
        self._rate_bias = errors.rate_bias * random.standard_normal(3)
        self._attitude = RandomDrift(errors.attitude, _ATTITUDE_TIME, period, random)

    def apply(self, reading: ImuReading) -> ImuReading:
        """Return attitude (x, y, z, w), angular velocity and specific force with errors."""
        attitude, rate, force = reading
        errors, noise = self._errors, self._random.standard_normal((2, 3))
        return (
            turned(attitude, self._attitude.update()),
            rate + self._rate_bias + errors.rate_noise * noise[0],
            force + self._force_bias + errors.force_noise * noise[1],
        )
