"""Errors of emulated sensors: delay, drift and noise."""

from collections import deque
from collections.abc import Callable, Sequence
from math import exp, sqrt
from typing import Generic, TypeVar

import numpy as np

from aerarm_ros.motion.signals import Array


def turned(quaternion: Array, angle: Array) -> Array:
    """Rotate a unit quaternion (x, y, z, w) by a small rotation (3,) [rad] in body axes."""
    x, y, z, w = quaternion.tolist()
    a, b, c = (0.5 * angle).tolist()
    result: Array = np.array(
        [
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
            w - x * a - y * b - z * c,
        ]
    )
    result /= np.linalg.norm(result)
    return result


Reading = TypeVar('Reading')


class DelayedSensor(Generic[Reading]):
    """Emulated sensor with periodic readings that arrive after a delay.

    Parameters
    ----------
    read : callable
        Returns the present reading, including its errors.
    rate : float
        Rate of readings [Hz].
    cycle : float
        Time between two calls of `update` [s]; the interval of readings is a whole number of
        cycles.
    delay : float
        Age of a reading at its arrival [s], rounded to whole cycles.

    Attributes
    ----------
    period_ns : int
        Interval of readings [ns].
    """

    def __init__(
        self, read: Callable[[], Reading], rate: float, cycle: float, delay: float = 0.0
    ) -> None:
        self._read = read
        self._cycles = max(1, round(1.0 / (rate * cycle)))
        self._delay = round(delay / cycle)
        self.period_ns = self._cycles * round(cycle * 1e9)
        self._count = 0
        self._under_way: deque[tuple[int, int, Reading]] = deque()

    def restart(self) -> None:
        """Restart: read the sensor in the next cycle, and drop readings that are under way."""
        self._count = 0
        self._under_way.clear()

    def update(self, stamp_ns: int) -> tuple[int, Reading] | None:
        """Advance by the cycle that begins at `stamp_ns` [ns]; return an arriving reading.

        Returns
        -------
        tuple or None
            Stamp [ns] and content of a reading, if one arrives in this cycle.
        """
        if self._count % self._cycles == 0:
            self._under_way.append((self._count + self._delay, stamp_ns, self._read()))
        arrives = bool(self._under_way) and self._under_way[0][0] <= self._count
        self._count += 1
        return self._under_way.popleft()[1:] if arrives else None


_BLOCK = 4096  # number of random numbers drawn at once


class RandomDrift:
    """First-order Gauss-Markov process on three independent axes.

    The autocorrelation is `deviation^2 exp(-|t| / correlation_time)`. The process is the
    longitudinal gust of Dryden's spectrum, with the scale length over the airspeed as correlation
    time.

    Parameters
    ----------
    deviation : float
        Standard deviation of each axis, in any unit.
    correlation_time, period : float
        Correlation time, and the time between two calls of `update` [s].
    random : numpy.random.Generator
    """

    def __init__(
        self, deviation: float, correlation_time: float, period: float, random: np.random.Generator
    ) -> None:
        self._decay = exp(-period / correlation_time)
        self._drive = deviation * sqrt(1.0 - self._decay**2)
        self._random = random
        self._noise = np.empty((0, 3))
        self._next = 0
        self.value = deviation * random.standard_normal(3)

    def update(self) -> Array:
        """Advance by one period and return the new value (3,) of the process."""
        if self._next == len(self._noise):
            self._noise = self._drive * self._random.standard_normal((_BLOCK, 3))
            self._next = 0
        self.value = self._decay * self.value + self._noise[self._next]
        self._next += 1
        return self.value


class BandLimitedNoise:
    """White noise after a Butterworth low-pass filter, on three independent axes.

    Parameters
    ----------
    deviation : float
        Standard deviation of each axis, in any unit.
    cutoff : float
        Cut-off frequency of the filter [Hz].
    period : float
        Time between two calls of `update` [s].
    random : numpy.random.Generator
    """

    def __init__(
        self, deviation: float, cutoff: float, period: float, random: np.random.Generator
    ) -> None:
        # Imported here, because it takes long, and `--help` does not need it.
        from scipy.signal import butter, sosfilt, sosfilt_zi

        self._filter = butter(2, cutoff, fs=1.0 / period, output='sos')
        length = round(10.0 / (cutoff * period))
        answer = sosfilt(self._filter, np.eye(1, length)[0])
        self._drive = deviation / float(np.sqrt(answer @ answer))
        self._random = random
        self._state = 0.0 * sosfilt_zi(self._filter)[..., np.newaxis].repeat(3, axis=2)
        self._next = 0
        self._values: Array = np.empty((0, 3))
        for _ in range(1 + length // _BLOCK):  # until the initial state has decayed
            self._draw()
        self._next = len(self._values)
        self.value: Array = self._values[-1]

    def _draw(self) -> None:
        from scipy.signal import sosfilt

        noise = self._drive * self._random.standard_normal((_BLOCK, 3))
        self._values, self._state = sosfilt(self._filter, noise, axis=0, zi=self._state)
        self._next = 0

    def update(self) -> Array:
        """Advance by one period and return the new value (3,) of the process."""
        if self._next == len(self._values):
            self._draw()
        self.value = self._values[self._next]
        self._next += 1
        return self.value


ImuReading = tuple[Array, Array, Array]

_ATTITUDE_TIME = 10.0  # [s] correlation time of an attitude filter's error


class FaultyImu:
    """Adds errors to the readings of an ideal IMU; all errors are standard deviations per axis.

    Parameters
    ----------
    period : float
        Interval of readings [s].
    seed : int
        Seed of the errors.
    force_noise, rate_noise : float
        White noise of specific force [m/s^2] and angular velocity [rad/s] in a sample.
    force_bias, rate_bias : float
        Constant error of specific force [m/s^2] and angular velocity [rad/s].
    attitude : float
        Slowly changing error of the attitude [rad].
    """

    def __init__(
        self, period: float, seed: int, force_noise: float = 0.0, rate_noise: float = 0.0,
        force_bias: float = 0.0, rate_bias: float = 0.0, attitude: float = 0.0,
    ) -> None:  # fmt: skip
        self._random = random = np.random.default_rng(seed)
        self._force_noise, self._rate_noise = force_noise, rate_noise
        self._force_bias = force_bias * random.standard_normal(3)
        self._rate_bias = rate_bias * random.standard_normal(3)
        self._attitude = RandomDrift(attitude, _ATTITUDE_TIME, period, random)

    def apply(self, reading: ImuReading) -> ImuReading:
        """Return attitude (x, y, z, w), angular velocity and specific force with added errors."""
        attitude, rate, force = reading
        noise = self._random.standard_normal((2, 3))
        return (
            turned(attitude, self._attitude.update()),
            rate + self._rate_bias + self._rate_noise * noise[0],
            force + self._force_bias + self._force_noise * noise[1],
        )


OdometryReading = tuple[Array, Array, Array, Array]


class NoisyOdometry:
    """Adds white noise to the true odometry.

    Parameters
    ----------
    seed : int
        Seed of the noise.
    deviations : sequence of float
        Standard deviations per axis of position [m], velocity [m/s], attitude [rad] and angular
        velocity [rad/s].
    """

    def __init__(self, seed: int, deviations: Sequence[float]) -> None:
        self._deviations = deviations
        self._random = np.random.default_rng(seed)

    def apply(self, reading: OdometryReading) -> OdometryReading:
        """Return position, attitude, velocity and angular velocity with added noise."""
        of_place, of_speed, of_attitude, of_rate = self._deviations
        position, attitude, velocity, rate = reading
        noise = self._random.standard_normal((4, 3))
        return (
            position + of_place * noise[0],
            turned(attitude, of_attitude * noise[1]),
            velocity + of_speed * noise[2],
            rate + of_rate * noise[3],
        )
