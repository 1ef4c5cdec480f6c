"""Smooth tool motion towards successive target positions."""

from math import sqrt

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import RejectedInputError, checked_vector, positive
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array, TaskReference, limited

# [s] Targets further apart in time are separate targets, not samples of a path.
_STREAM_GAP = 0.25
# Silence in periods of the stream after which the stream counts as ended.
_SILENT_PERIODS = 2.0


class TargetFollower:
    """Second-order system that moves the tool's reference to targets within limits, thesis 2.5.

    The tool approaches a single target without overshoot. The tool follows a stream of targets
    with the velocity between them, so a constant velocity causes no lag. After the stream the tool
    stays at the last target.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the moved frame.
    frequency : float
        Natural frequency [rad/s].
    velocity_max, acceleration_max : float
        Limits of the tool's velocity [m/s] and acceleration [m/s^2].
    reach : float
        Largest distance [m] of a target from the base.

    Attributes
    ----------
    place, velocity : (3,) ndarray
        Present position [m] and velocity [m/s] of the tool's reference, in the base frame.

    Raises
    ------
    ValueError
        If a value is not positive.
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
        """Start at the tool's position for joint angles `q` (n,) [rad], as the target too."""
        self.start(self._kinematics.position(q))

    def start(self, p: Array, velocity: Array | None = None, target: Array | None = None) -> None:
        """Start at a position (3,) [m] with a velocity (3,) [m/s]; the default velocity is zero.

        The reference then moves to `target` (3,) [m]; without a target it stays.
        """
        self.place = p
        self.velocity = np.zeros(3) if velocity is None else velocity
        self._target = p if target is None else target
        self._target_velocity = np.zeros(3)
        self._target_time: float | None = None
        self._moving_until = -np.inf

    def set_target(self, p: npt.ArrayLike, now: float) -> None:
        """Set the target position `p` (3,) [m] in the base frame, valid at `now` [s].

        Raises
        ------
        RejectedInputError
            If the target is not finite or out of reach.
        """
        target = checked_vector('tool target', p, 'm')
        distance = float(np.linalg.norm(target))
        if distance > self._reach:
            place = ', '.join(f'{x:.3f}' for x in target)
            raise RejectedInputError(
                f'tool target {place} is {distance:.3f} m from the base, '
                f'{distance - self._reach:.4g} m beyond the reach of the arm: check the frame '
                'and the unit'
            )
        velocity, self._moving_until = np.zeros(3), -np.inf
        period = np.inf if self._target_time is None else now - self._target_time
        if 1e-4 < period < _STREAM_GAP:
            velocity = limited((target - self._target) / period, self._velocity_max)
            self._moving_until = now + _SILENT_PERIODS * period
        self._target, self._target_velocity, self._target_time = target, velocity, now

    def update(self, q: Array, now: float, dt: float) -> TaskReference:
        """Return the tool's reference after a cycle of `dt` [s] that ends at `now` [s].

        The arm's posture `q` is not used: the reference does not follow the arm.
        """
        target, target_velocity = self._target, self._target_velocity
        if now > self._moving_until or self._target_time is None:
            target_velocity = np.zeros(3)
        else:
            target = target + max(0.0, now - self._target_time) * target_velocity
        error = target - self.place
        w = self._frequency
        # Largest speed from which the tool can still stop at the target.
        speed = min(
            self._velocity_max, sqrt(self._acceleration_max * (sqrt(error @ error) + 1e-12))
        )
        approach = limited(0.5 * w * error, speed)
        wanted = 2.0 * w * (approach + target_velocity - self.velocity)
        acceleration = limited(wanted, self._acceleration_max)
        self.place = self.place + dt * (self.velocity + (0.5 * dt) * acceleration)
        self.velocity = self.velocity + dt * acceleration
        return TaskReference(self.place, self.velocity, acceleration)
