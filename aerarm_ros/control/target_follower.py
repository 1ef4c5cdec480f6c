"""A smooth motion of the tool toward targets that come one by one."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.gains import positive
from aerarm_ros.control.rejected_input_error import RejectedInputError
from aerarm_ros.control.task_reference import TaskReference
from aerarm_ros.model.kinematics import Kinematics

Array = npt.NDArray[np.float64]

# Targets further apart in time are separate targets, not samples of a path.
_STREAM_GAP = 0.25


class TargetFollower:
    """Reference generator of thesis 2.5: second order, critically damped, limited.

    A single target is approached without overshoot; a stream of them is followed with the
    velocity between them, so that a constant velocity is tracked without lag.

    Parameters
    ----------
    kinematics : Kinematics
        Of the frame that is moved.
    frequency : float
        Natural frequency [rad/s].
    velocity_max, acceleration_max : float
        [m/s], [m/s^2]
    reach : float
        Largest distance [m] of a target from the base.

    Raises
    ------
    ValueError
        If a value isn't positive.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        frequency: float = 15.0,
        velocity_max: float = 0.8,
        acceleration_max: float = 4.0,
        reach: float = np.inf,
    ) -> None:
        self._kinematics = kinematics
        self._frequency = positive('frequency', frequency)
        self._velocity_max = positive('velocity_max', velocity_max)
        self._acceleration_max = positive('acceleration_max', acceleration_max)
        self._reach = reach
        self.take_over(np.zeros(kinematics.robot.n))

    def take_over(self, q: Array) -> None:
        """Stay where the tool is at `q` (n,) [rad] until a target comes."""
        self._p = self._kinematics.position(q)
        self._v = np.zeros(3)
        self._target = self._p
        self._target_velocity = np.zeros(3)
        self._target_time: float | None = None

    def set_target(self, p: npt.ArrayLike, now: float) -> None:
        """Take the target `p` (3,) [m], in the base frame, valid at `now` [s].

        Raises
        ------
        RejectedInputError
            If it isn't finite or out of reach.
        """
        target = np.array(p, dtype=float)
        if target.shape != (3,) or not np.all(np.isfinite(target)):
            raise RejectedInputError(f'tool target {target} must be three finite numbers [m]')
        distance = float(np.linalg.norm(target))
        if distance > self._reach:
            raise RejectedInputError(
                f'tool target {target} is {distance:.3g} m from the base, the arm reaches '
                f'{self._reach:.3g} m: check the frame and the unit'
            )
        velocity = np.zeros(3)
        if self._target_time is not None and 1e-4 < now - self._target_time < _STREAM_GAP:
            velocity = (target - self._target) / (now - self._target_time)
            velocity = _limited(velocity, self._velocity_max)
        self._target, self._target_velocity, self._target_time = target, velocity, now

    def update(self, q: Array, now: float, dt: float) -> TaskReference:
        """Return the reference after a cycle of `dt` [s] that ends at `now` [s].

        The arm's posture `q` isn't used: the reference doesn't follow the arm.
        """
        age = 0.0 if self._target_time is None else max(0.0, now - self._target_time)
        if age > _STREAM_GAP:
            self._target = self._target + _STREAM_GAP * self._target_velocity
            self._target_velocity = np.zeros(3)
            self._target_time, age = None, 0.0
        error = self._target + age * self._target_velocity - self._p
        w = self._frequency
        # The speed from which the tool can still stop at the target.
        speed = min(
            self._velocity_max,
            float(np.sqrt(self._acceleration_max * (np.linalg.norm(error) + 1e-12))),
        )
        approach = _limited(0.5 * w * error, speed)
        wanted = 2.0 * w * (approach + self._target_velocity - self._v)
        acceleration = _limited(wanted, self._acceleration_max)
        self._p = self._p + dt * (self._v + (0.5 * dt) * acceleration)
        self._v = self._v + dt * acceleration
        return TaskReference(self._p, self._v, acceleration)


def _limited(vector: Array, length: float) -> Array:
    """Return `vector`, shortened to `length` if it is longer."""
    norm = float(np.linalg.norm(vector))
    return vector if norm <= length else (length / norm) * vector
