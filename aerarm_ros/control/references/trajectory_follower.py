"""Executes trajectories, set points and streamed references in time."""

from typing import Protocol

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.control.references.blend import Blend
from aerarm_ros.control.references.follower_tolerances import FollowerTolerances
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.motion_end import MotionEnd
from aerarm_ros.control.references.streamed_point import StreamedPoint
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.smooth_step import rest_to_rest_duration

Array = npt.NDArray[np.float64]


class _Motion(Protocol):
    @property
    def duration(self) -> float: ...

    def evaluate(self, time: float) -> JointReference: ...


class TrajectoryFollower:
    """What the joints should do now, always continuous up to the acceleration.

    A new motion replaces the running one at any time: the difference between the two is
    blended out (see `Blend`). After its end, and after an abort, the arm holds. Times are
    injected [s], of any steady clock.

    Parameters
    ----------
    limits : JointLimits
    tolerances : FollowerTolerances
    interpolation : str
        'cubic' or 'quintic', for trajectories.

    Attributes
    ----------
    status : str
        'holding', 'moving' or 'streaming'.
    outcome : str
        How the last motion ended, for people.
    motion : int
        Number of the motion under way; another one, or a hold, has another number.
    end : MotionEnd
        How the last motion ended.
    reference : JointReference
        The one returned last.
    """

    def __init__(
        self,
        limits: JointLimits,
        tolerances: FollowerTolerances,
        interpolation: str = 'quintic',
    ) -> None:
        if interpolation not in ('cubic', 'quintic'):
            raise ValueError(f"interpolation = {interpolation!r} must be 'cubic' or 'quintic'")
        self.interpolation = interpolation
        self._limits = limits
        self._tolerances = tolerances
        self.outcome = 'no motion yet'
        self.end = MotionEnd.STOPPED
        self.status = 'holding'
        self.motion = 0
        self._until = np.inf  # when the reference is at the motion's goal [s]
        self.take_over(np.zeros(limits.n))

    @property
    def limits(self) -> JointLimits:
        """Limits every reference is checked against."""
        return self._limits

    @property
    def tolerances(self) -> FollowerTolerances:
        """Tolerances of motions that bring none of their own."""
        return self._tolerances

    @property
    def elapsed(self) -> float:
        """Time of the motion under way at the last update [s]."""
        return self._elapsed

    def take_over(self, q: npt.ArrayLike) -> None:
        """Hold the present posture `q` (n,) [rad] from now on."""
        if self.status != 'holding':
            self.outcome, self.end = 'stopped: control began anew', MotionEnd.STOPPED
        self.reference = JointReference.at_rest(q)
        self._blend: Blend | None = None
        self._replaced = 0.0
        self._begin(StreamedPoint(self.reference, np.inf), 0.0, 'holding')

    def follow(
        self,
        trajectory: JointTrajectory,
        now: float,
        start: float | None = None,
        tolerances: FollowerTolerances | None = None,
        is_goal: bool = False,
    ) -> None:
        """Start a trajectory, or take a streamed point.

        Parameters
        ----------
        trajectory : JointTrajectory
        now : float
            [s]
        start : float, optional
            When its time zero is [s], if that isn't now. What lies in the past is skipped.
        tolerances : FollowerTolerances, optional
            Path, goal and goal time of this motion, if they aren't those of the follower.
        is_goal : bool
            Whether a single point for now is where to stay, and not the first of a stream.

        Raises
        ------
        RejectedInputError
            If it starts too far from the present reference or leaves the limits.
        """
        is_streamed = trajectory.is_single_point and not is_goal
        if is_streamed:
            zero = np.zeros(self._limits.n)
            rows = (trajectory.q, trajectory.dq, trajectory.ddq)
            point = JointReference(*(zero if row is None else row[0] for row in rows))
            motion: _Motion = StreamedPoint(point, self._tolerances.stream_timeout)
        elif trajectory.is_single_point:
            motion = StreamedPoint(trajectory.posture(), 0.0)
        else:
            motion = trajectory.path(self.reference.q, self.interpolation)
        begin = now if start is None else start
        self._check_start(motion.evaluate(now - begin).q)
        status = 'streaming' if is_streamed else 'moving'
        self._replace(motion, now, status, begin)
        self._used = tolerances or self._tolerances

    def go_to(self, q: Array, now: float) -> None:
        """Go to rest at `q` (n,) [rad] on a quintic that uses half of what limits allow.

        Raises
        ------
        RejectedInputError
            If the set point is outside the limits.
        """
        limits = self._limits
        limits.check_position('set point', q)
        duration = rest_to_rest_duration(
            q - self.reference.q, 0.5 * limits.velocity_max, 0.5 * limits.acceleration_max, 0.1
        )
        path = PolynomialPath.rest_to_rest(self.reference.q, q, duration)
        self._replace(path, now, 'moving')

    def stop(self, now: float, reason: str, q: Array | None = None) -> None:
        """Brake smoothly and hold: at `q` (n,) [rad], or as soon as the motion can stop."""
        if q is None:
            dq = self.reference.dq
            # On average the blend brakes with a quarter of the largest acceleration.
            q = self.reference.q + 2.0 * dq * np.abs(dq) / self._limits.acceleration_max
        q = np.clip(q, self._limits.position_min, self._limits.position_max)
        self._replace(StreamedPoint(JointReference.at_rest(q), np.inf), now, 'holding')
        self.outcome, self.end = reason, MotionEnd.STOPPED

    def update(self, q: Array, now: float, dt: float = 0.0) -> JointReference:
        """Return the reference at `now`, with the arm measured at `q` (n,) [rad].

        `dt` isn't used: the reference is a function of time.
        """
        self.reference = self._evaluate(now)
        if self._blend is not None and now - self._replaced >= self._blend.duration:
            self._blend = None
        self._elapsed = now - self._start
        if self.status != 'holding':
            self._watch(q, now)
        return self.reference

    def ahead(self, times: Array) -> JointReference:
        """Return the references (M, n) at times (M,) [s] from now on, if nothing new comes."""
        rows = [self._evaluate(time) for time in times.tolist()]
        return JointReference(*map(np.array, zip(*rows, strict=True)))

    def _evaluate(self, now: float) -> JointReference:
        reference = self._motion.evaluate(now - self._start)
        elapsed = now - self._replaced
        if self._blend is None or elapsed >= self._blend.duration:
            return reference
        return self._blend.add_to(reference, elapsed)

    def _check_start(self, q: Array) -> None:
        distance = np.abs(q - self.reference.q)
        far = distance > self._tolerances.start
        if np.any(far):
            joint = int(np.argmax(far))
            raise RejectedInputError(
                f'trajectory: it starts {distance[joint]:.3g} rad away from '
                f'{self._limits.names[joint]} at {self.reference.q[joint]:.4g} rad (allowed: '
                f'{self._tolerances.start[joint]:.3g}): start where the arm is, or give the '
                'first point a time to get there'
            )

    def _replace(
        self, motion: _Motion, now: float, status: str, start: float | None = None
    ) -> None:
        begin = now if start is None else start
        old, new = self._evaluate(now), motion.evaluate(now - begin)
        deviation = JointReference(old.q - new.q, old.dq - new.dq, old.ddq - new.ddq)
        self._blend = Blend(deviation, self._limits)
        self._replaced = now
        self.end = MotionEnd.REPLACED
        self._begin(motion, begin, status)
        if status == 'moving':
            # Until the old motion is blended out the reference is not at the goal.
            self._until = max(self._until, now + self._blend.duration)

    def _begin(self, motion: _Motion, start: float, status: str) -> None:
        self._motion = motion
        self._start = start
        self._until = start + motion.duration
        self._elapsed = 0.0
        self.status = status
        self.motion += 1
        self._used = self._tolerances

    def _watch(self, q: Array, now: float) -> None:
        """End the motion at its goal, when its stream falls silent, or when the arm lags."""
        error, used = np.abs(self.reference.q - q), self._used
        if (error > used.path).any():
            joint = int(np.argmax(error / used.path))
            # Where the arm is, so that whatever blocks it isn't pushed on.
            reason = f'stopped: {self._limits.names[joint]} {error[joint]:.3g} rad off path'
            self.stop(now, reason, q)
            self.end = MotionEnd.OFF_PATH
        elif now < self._until:
            return
        elif self.status == 'streaming':
            self.stop(now, 'stopped: no streamed point in time')
        elif (error <= used.goal).all():
            self.status, self.end = 'holding', MotionEnd.REACHED
            self.outcome = f'reached, error {error.max():.2g} rad'
        elif now > self._until + used.goal_time:
            joint = int(np.argmax(error / used.goal))
            self.status, self.end = 'holding', MotionEnd.OFF_GOAL
            self.outcome = f'missed: {self._limits.names[joint]} {error[joint]:.3g} rad off goal'
