"""Types for pose and motion of the drone: state, target, odometry sample and path."""

from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array


class FlightState(NamedTuple):
    """Pose and velocity of the drone's body frame.

    Attributes
    ----------
    position, velocity : (3,) ndarray
        Position [m] and velocity [m/s] of the frame's origin in the world.
    rotation : (3, 3) ndarray
        Body to world.
    rate : (3,) ndarray
        Angular velocity in body axes [rad/s].
    specific_force : (3,) ndarray, optional
        Specific force at the IMU, in body axes [m/s^2].
    """

    position: Array
    velocity: Array
    rotation: Array
    rate: Array
    specific_force: Array | None = None


_ZERO = np.zeros(3)


class FlightTarget(NamedTuple):
    """Position and heading at which the drone hovers, or through which it flies.

    Attributes
    ----------
    position : (3,) ndarray
        Of the body frame's origin in the world [m].
    yaw : float
        Rotation of the body about the vertical [rad].
    velocity, acceleration : (3,) ndarray
        Velocity [m/s] and acceleration [m/s^2] of that origin in the world.
    """

    position: Array
    yaw: float
    velocity: Array = _ZERO
    acceleration: Array = _ZERO

    @classmethod
    def here(cls, state: FlightState) -> 'FlightTarget':
        """Return the present position and heading of a drone, as a target at rest."""
        return cls(np.array(state.position), yaw_of(state.rotation))


def yaw_of(rotation: Array) -> float:
    """Return the heading [rad] of an attitude: the direction of the body's x axis."""
    return float(np.arctan2(rotation[1, 0], rotation[0, 0]))


# Larger values indicate a fault of the odometry.
_POSITION_MAX, _SPEED_MAX, _RATE_MAX = 1e5, 100.0, 40.0


@dataclass(frozen=True, eq=False)
class OdometrySample:
    """Validated odometry sample with the conventions of nav_msgs/Odometry.

    Attributes
    ----------
    stamp : float
        Time of the sample [s].
    position : (3,) ndarray
        Of the body frame's origin in the world [m].
    attitude : (4,) ndarray
        Quaternion (x, y, z, w), body to world, normalized.
    velocity, rate : (3,) ndarray
        Velocity [m/s] and angular velocity [rad/s] in body axes.

    Raises
    ------
    RejectedInputError
        If a number is not finite, the quaternion is not valid, or a value is too large for the
        expected unit.
    """

    stamp: float
    position: Array
    attitude: Array
    velocity: Array
    rate: Array

    def __post_init__(self) -> None:
        """Check that every number is finite and plausible."""
        numbers = [self.stamp, *self.position, *self.attitude, *self.velocity, *self.rate]
        if not np.all(np.isfinite(numbers)):
            raise RejectedInputError('odometry: a value is NaN or infinite; check its source')
        norm = float(np.linalg.norm(self.attitude))
        if not 0.9 < norm < 1.1:
            raise RejectedInputError(
                f'odometry: the orientation quaternion has length {norm:.3g} instead of '
                '1; check its source'
            )
        for name, vector, limit, unit in (
            ('position', self.position, _POSITION_MAX, 'm'),
            ('velocity', self.velocity, _SPEED_MAX, 'm/s'),
            ('angular velocity', self.rate, _RATE_MAX, 'rad/s'),
        ):
            if np.linalg.norm(vector) > limit:
                raise RejectedInputError(
                    f'odometry: the {name} is above {limit:g} {unit}; check its unit'
                )
        object.__setattr__(self, 'attitude', self.attitude / norm)


_KEPT = 256
SET_BACK = 1.0  # [s]; a larger step back means that the clock was set back


class StampedValues:
    """Buffer of stamped values, which interpolates between them.

    Parameters
    ----------
    hold_time : float
        Time for which the last value remains valid [s].
    """

    def __init__(self, hold_time: float) -> None:
        self._hold_time = hold_time
        self._times: deque[float] = deque(maxlen=_KEPT)
        self._values: deque[Array] = deque(maxlen=_KEPT)

    @property
    def newest(self) -> float | None:
        """Time of the newest value [s], None without values."""
        return self._times[-1] if self._times else None

    def add(self, time: float, value: Array) -> None:
        """Add the value at a time [s]; a value that is not newer than the last is ignored."""
        times = self._times
        if times and time <= times[-1]:
            if time > times[-1] - SET_BACK:
                return
            times.clear()
            self._values.clear()
        times.append(time)
        self._values.append(value)

    def between(self, time: float) -> Array | None:
        """Return the interpolated value at a time [s], None if no newer value exists."""
        times = self._times
        return self.at(time) if times and times[0] <= time <= times[-1] else None

    def at(self, time: float) -> Array | None:
        """Return the value at a time [s], interpolated or held; None if the value is unknown."""
        times, values = self._times, self._values
        if not times or time > times[-1] + self._hold_time:
            return None
        after = bisect_right(times, time)
        if after == len(times):
            return values[-1]
        if after == 0:
            return values[0] if time > times[0] - self._hold_time else None
        share = (time - times[after - 1]) / (times[after] - times[after - 1])
        return values[after - 1] + share * (values[after] - values[after - 1])


_PATH_SPEED_MAX = 20.0  # [m/s]
_ACCELERATION_MAX = 20.0  # [m/s^2]


class FlightPath:
    """Path of quintics through positions and headings; at its end the drone hovers.

    Parameters
    ----------
    times : (M,) array_like
        Times of the points from the start [s], rising, the first not negative.
    positions : (M, 3) array_like
        Positions of the body frame's origin in the world [m].
    yaws : (M,) array_like
        Headings of the body at the points [rad].
    velocities, accelerations : (M, 3) array_like, optional
        Velocities [m/s] and accelerations [m/s^2] at the points; by default slopes between the
        neighbouring points, and zero at both ends.
    start : FlightTarget, optional
        Start of the path if the first point has a time above zero.

    Raises
    ------
    RejectedInputError
        If a number is missing or not finite, times do not rise, or the path is too fast.
    """

    def __init__(
        self,
        times: npt.ArrayLike,
        positions: npt.ArrayLike,
        yaws: npt.ArrayLike,
        velocities: npt.ArrayLike | None = None,
        accelerations: npt.ArrayLike | None = None,
        start: FlightTarget | None = None,
    ) -> None:
        t, p, yaw = (np.array(values, dtype=float) for values in (times, positions, yaws))
        if t.ndim != 1 or not len(t) or p.shape != (len(t), 3) or yaw.shape != t.shape:
            raise RejectedInputError('flight path: each point needs a time and a pose')
        v, a = (_rows(values, p.shape) for values in (velocities, accelerations))
        given = [rows for rows in (t, p, yaw, v, a) if rows is not None]
        if not all(np.all(np.isfinite(rows)) for rows in given):
            raise RejectedInputError('flight path: all numbers must be finite')
        if t[0] < 0.0 or np.any(np.diff(t) <= 0.0):
            raise RejectedInputError('flight path: times must increase and must not be negative')
        if t[0] > 0.0 and start is not None:
            t = np.concatenate([[0.0], t])
            p, yaw = np.vstack([start.position, p]), np.concatenate([[start.yaw], yaw])
            v, a = (None if rows is None else np.vstack([np.zeros(3), rows]) for rows in (v, a))
        if len(t) == 1:
            t, p, yaw = np.array([t[0], t[0] + 1.0]), np.repeat(p, 2, axis=0), np.repeat(yaw, 2)
            v = a = None
        values = np.column_stack([p, np.unwrap(yaw)])
        slopes = _slopes(t, values)
        if v is not None:
            slopes[:, :3] = v
        curvatures = _slopes(t, slopes)
        if a is not None:
            curvatures[:, :3] = a
        self._path = PolynomialPath.quintic(t - t[0], values, slopes, curvatures)
        self._begin = float(t[0])
        samples = self._path.sample()
        fastest = float(np.linalg.norm(samples.dq[:, :3], axis=1).max())
        hardest = float(np.linalg.norm(samples.ddq[:, :3], axis=1).max())
        if fastest > _PATH_SPEED_MAX or hardest > _ACCELERATION_MAX:
            raise RejectedInputError(
                f'flight path: the path needs {fastest:.1f} m/s and {hardest:.1f} m/s^2 (limits '
                f'{_SPEED_MAX:g} and {_ACCELERATION_MAX:g}); give the points more time'
            )

    def at(self, time: float) -> FlightTarget:
        """Return the drone's reference `time` [s] after the start."""
        q, dq, ddq = self._path.evaluate(float(time - self._begin))
        return FlightTarget(q[:3], float(q[3]), dq[:3], ddq[:3])


def _rows(values: npt.ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
    if values is None:
        return None
    rows = np.array(values, dtype=float)
    if rows.shape != shape:
        raise RejectedInputError(
            'flight path: give velocities, and likewise accelerations, for all points or for none'
        )
    return rows


def _slopes(times: Array, values: Array) -> Array:
    """Return the slope at each point by finite differences; zero at both ends."""
    slopes = np.zeros_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, np.newaxis]
    return slopes
