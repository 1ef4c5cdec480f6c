"""What wanders at random: a gust, a sensor's slow error."""

from math import exp, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_BLOCK = 4096  # random numbers are drawn this many at a time


class RandomDrift:
    """A first-order Gauss-Markov process of three independent axes (white noise, filtered).

    Its autocorrelation is `deviation^2 exp(-|t| / correlation_time)`: the longitudinal gust of
    Dryden's spectrum, with the scale length over the airspeed as correlation time.

    Parameters
    ----------
    deviation : float
        Standard deviation of each axis, in any unit.
    correlation_time, period : float
        [s]; the period is that of `update`.
    random : numpy.random.Generator
    """

    def __init__(
        self,
        deviation: float,
        correlation_time: float,
        period: float,
        random: np.random.Generator,
    ) -> None:
        self._decay = exp(-period / correlation_time)
        self._drive = deviation * sqrt(1.0 - self._decay**2)
        self._random = random
        self._noise = np.empty((0, 3))
        self._next = 0
        self.value = deviation * random.standard_normal(3)

    def update(self) -> Array:
        """Return the value (3,) a period later."""
        if self._next == len(self._noise):
            self._noise = self._drive * self._random.standard_normal((_BLOCK, 3))
            self._next = 0
        self.value = self._decay * self.value + self._noise[self._next]
        self._next += 1
        return self.value
