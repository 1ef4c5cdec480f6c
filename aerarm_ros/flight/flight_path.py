"""A way that the drone is to take in time."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.flight.flight_target import FlightTarget
from aerarm_ros.motion.polynomial_path import PolynomialPath

Array = npt.NDArray[np.float64]

_SPEED_MAX = 20.0  # [m/s]
_ACCELERATION_MAX = 20.0  # [m/s^2]


class FlightPath:
    """Quintics through places and headings; where it ends the drone stays.

    Parameters
    ----------
    times : (M,) array_like
        Of the points, from the start [s], rising, the first not negative.
    positions : (M, 3) array_like
        Of the body frame's origin in the world [m].
    yaws : (M,) array_like
        [rad]
    velocities, accelerations : (M, 3) array_like, optional
        [m/s], [m/s^2]; without them the slopes between neighbours, zero at both ends.
    start : FlightTarget, optional
        From where the way leads to a first point that lies ahead in time.

    Raises
    ------
    RejectedInputError
        If a number is missing or not finite, times do not rise, or no drone is as fast.
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
            raise RejectedInputError('flight path: its numbers must be finite')
        if t[0] < 0.0 or np.any(np.diff(t) <= 0.0):
            raise RejectedInputError('flight path: its times must rise, and not begin before zero')
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
        if fastest > _SPEED_MAX or hardest > _ACCELERATION_MAX:
            raise RejectedInputError(
                f'flight path: it takes {fastest:.1f} m/s and {hardest:.1f} m/s^2 (at most '
                f'{_SPEED_MAX:g} and {_ACCELERATION_MAX:g}): give its points more time'
            )

    def at(self, time: float) -> FlightTarget:
        """Return where the drone shall be `time` [s] after the start."""
        q, dq, ddq = self._path.evaluate(float(time - self._begin))
        return FlightTarget(q[:3], float(q[3]), dq[:3], ddq[:3])


def _rows(values: npt.ArrayLike | None, shape: tuple[int, ...]) -> Array | None:
    if values is None:
        return None
    rows = np.array(values, dtype=float)
    if rows.shape != shape:
        raise RejectedInputError('flight path: every point has a velocity, or none; so with others')
    return rows


def _slopes(times: Array, values: Array) -> Array:
    """Return the slope at each point from its neighbours, zero at both ends."""
    slopes = np.zeros_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, np.newaxis]
    return slopes
