"""Execution of joint trajectories, set points and streamed joint references."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import JointLimits, RejectedInputError, non_negative, positive
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.reference_chase import ReferenceChase
from aerarm_ros.control.references.transition import (
    FollowedMotion,
    Posture,
    StreamedPoint,
    Transition,
    find_transition,
    joined,
    rest_to_rest_path,
)
from aerarm_ros.motion.path_stop import acceleration_rows, brake, stop_along
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import Array, JointReference


class MotionEnd(Enum):
    """Reason why a trajectory follower ended a motion."""

    REACHED = 'the motion reached its goal'
    OFF_PATH = 'the arm left the tolerance around its path'
    OFF_GOAL = 'the arm was outside the goal tolerance at the end of the goal time'
    REPLACED = 'another motion replaced this one'
    STOPPED = 'the motion was stopped, or the controller was reset'


@dataclass(frozen=True, eq=False)
class FollowerTolerances:
    """Position tolerances of n joints, and time limits, for one motion of the follower.

    Attributes
    ----------
    start : (n,) ndarray
        Distance [rad] of a trajectory's first point from the present reference.
    path : (n,) ndarray
        Tracking error [rad] beyond which the motion is aborted; positive, infinite for no check.
    goal : (n,) ndarray
        Error [rad] at which the goal counts as reached; positive, infinite for no check.
    goal_time : float
        Time [s] after the end of the motion within which the arm must reach the goal.
    stream_timeout : float
        Time [s] without a new streamed point after which the reference brakes.
    """

    start: Array
    path: Array
    goal: Array
    goal_time: float
    stream_timeout: float

    @classmethod
    def uniform(
        cls,
        n: int,
        start: float = 0.1,
        path: float = 0.3,
        goal: float = 0.01,
        goal_time: float = 1.0,
        stream_timeout: float = 0.1,
    ) -> 'FollowerTolerances':
        """Return tolerances with the same values for each of n joints.

        Raises
        ------
        ValueError
            If a value is not positive.
        """
        return cls(
            start=non_negative('start', start, n),
            path=np.full(n, _limit('path', path)),
            goal=np.full(n, _limit('goal', goal)),
            goal_time=_limit('goal_time', goal_time),
            stream_timeout=positive('stream_timeout', stream_timeout),
        )


def _limit(name: str, value: float) -> float:
    return value if value == np.inf else positive(name, value)


# Longest time to a trajectory's first point without an intermediate stop, in multiples of the
# shortest stopping time.
_JOINED = 3.0


class TrajectoryFollower:
    """Follows joint trajectories and streamed points with references of continuous acceleration.

    A new motion replaces the running one at any time, by a transition within the limits (see
    `find_transition`). A stop follows the path of the present motion, see `stop_along`. For a
    stream, whose path is unknown, each joint brakes. After the end of a motion, and after an abort,
    the arm holds its position. The caller passes all times [s], from any steady clock.

    Parameters
    ----------
    govern : callable
        Returns a motion, possibly slowed down along its path, or rejects it (RejectedInputError).
        Streamed points and stops do not pass this function.
    chase : ReferenceChase, optional
        Limits the acceleration of a stream, whose path is unknown. The arm then lags behind a
        stream that is too fast.

    Attributes
    ----------
    limits : JointLimits
        Limits that every reference of the follower respects.
    tolerances : FollowerTolerances
        Default tolerances, for motions that specify none.
    elapsed : float
        Time [s] from the start of the present motion to the last update.
    status : str
        'holding', 'moving' or 'streaming'.
    outcome : str
        Description of the last motion's end.
    motion : int
        Number of the present motion; each motion or hold has another number.
    end : MotionEnd
        Reason for the last motion's end.
    reference : JointReference
        The last returned reference.
    """

    def __init__(
        self,
        limits: JointLimits,
        tolerances: FollowerTolerances,
        govern: Callable[[FollowedMotion], FollowedMotion] = lambda motion: motion,
        chase: ReferenceChase | None = None,
    ) -> None:
        self._govern, self._chase = govern, chase
        self.limits = limits
        self.tolerances = tolerances
        self.outcome = 'no motion yet'
        self.end = MotionEnd.STOPPED
        self.status = 'holding'
        self.motion = 0
        self._until = np.inf  # time at which the reference reaches the goal [s]
        self._silent_stream = ''  # outcome of a stream that ends by silence
        self.take_over(np.zeros(limits.n))

    def take_over(self, q: npt.ArrayLike) -> None:
        """Hold the present joint positions `q` (n,) [rad] from now on."""
        if self.status != 'holding':
            self.outcome, self.end = 'stopped: the controller was reset', MotionEnd.STOPPED
        self.reference = JointReference.at_rest(q)
        if self._chase is not None:
            self._chase.start(self.reference)
        self._begin(Posture(self.reference), 0.0, 0.0, 'holding')

    def follow(
        self,
        trajectory: JointTrajectory,
        now: float,
        start: float | None = None,
        tolerances: FollowerTolerances | None = None,
        is_goal: bool = False,
    ) -> None:
        """Start a joint trajectory, or follow a streamed point.

        Parameters
        ----------
        now : float
            Present time [s].
        start : float, optional
            Time zero of the trajectory [s], by default `now`. The part before `now` is skipped.
        tolerances : FollowerTolerances, optional
            Path, goal and goal time of this motion, by default those of the follower.
        is_goal : bool
            Whether a single point without a time is a goal, and not the first of a stream.

        Raises
        ------
        RejectedInputError
            If the motion starts too far from the present reference or leaves the limits, between
            its points or during the transition.
        """
        begin = now if start is None else start
        if trajectory.is_single_point and not is_goal:
            self._stream(trajectory, now, now - begin)
        else:
            motion, zero = self._goal(trajectory, now, begin)
            self._replace(self._govern(motion), now, zero, 'moving')
        self._used = tolerances or self.tolerances

    def check_goal(
        self, trajectory: JointTrajectory, now: float, start: float | None = None
    ) -> None:
        """Raise RejectedInputError if a trajectory cannot start now; any thread may call this.

        For the arguments see `follow`. The follower does not change.
        """
        self._goal(trajectory, now, now if start is None else start)

    def go_to(self, q: Array, now: float) -> None:
        """Move to joint positions `q` (n,) [rad] on a quintic that uses half of the limits.

        A moving arm first stops on its path.

        Raises
        ------
        RejectedInputError
            If the set point is outside the limits.
        """
        self.limits.check_position('set point', q)
        path = rest_to_rest_path(self.reference.q, q, self.limits)
        if self.moves:
            stop = self._stop(now)
            path = joined(stop, rest_to_rest_path(stop.evaluate(stop.duration).q, q, self.limits))
        self._replace(self._govern(path), now, now, 'moving')

    def stop(self, now: float, reason: str, q: Array | None = None) -> None:
        """Stop the motion along its path and hold; with `q` (n,) [rad], hold that posture."""
        if q is None:
            motion: FollowedMotion = self._stop(now)
        else:
            q = np.clip(q, self.limits.position_min, self.limits.position_max)
            motion = self._transition(Posture(JointReference.at_rest(q)), now, now)
        self._replace(motion, now, now, 'holding')
        self.outcome, self.end = reason, MotionEnd.STOPPED

    def update(self, q: Array, now: float, dt: float = 0.0) -> JointReference:
        """Return the reference at `now` [s]; `q` (n,) [rad] are the measured positions.

        `dt` [s] since the last update limits the acceleration of streams; otherwise the reference
        is a function of time.
        """
        self.reference = self._evaluate(now)
        if self._chase is not None:
            self.reference = self._chase.update(self.reference, dt, self.status == 'streaming')
        self.elapsed = now - self._zero
        if self.status != 'holding':
            self._watch(q, now)
        return self.reference

    def ahead(self, times: Array) -> JointReference:
        """Return the references (M, n) at times (M,) [s] as planned without further input."""
        rows = [self._evaluate(time) for time in times.tolist()]
        followed = JointReference(*map(np.array, zip(*rows, strict=True)))
        if self._chase is None or not len(times):
            return followed
        return self._chase.ahead(followed, times, self.status == 'streaming')

    def _evaluate(self, now: float) -> JointReference:
        motion, start = self._under_way
        return motion.evaluate(now - start)

    @property
    def _lags(self) -> bool:
        return self._chase is not None and self._chase.is_behind

    def _after(self, now: float) -> Callable[[float], JointReference]:
        """Return the planned reference as a function of the time [s] after `now`."""
        if self._lags:
            return brake(self.reference, self.limits.acceleration_max).evaluate
        motion, start = self._under_way
        return lambda time: motion.evaluate(now - start + time)

    @property
    def moves(self) -> bool:
        """Whether the reference has a velocity or acceleration, for example while it stops."""
        return bool(np.any(self.reference.dq) or np.any(self.reference.ddq))

    def _stop(self, now: float, share: float = 1.0) -> PolynomialPath:
        """Return the path that stops the present motion within `share` of the limits."""
        acceleration_max = share * self.limits.acceleration_max
        if self._lags:
            return brake(self.reference, acceleration_max)
        if self.status == 'streaming':
            return brake(self._evaluate(now), acceleration_max)
        motion = self._after(now)
        return stop_along(motion, 0.0, acceleration_rows(acceleration_max)).path(motion)

    def _transition(self, motion: PolynomialPath | Posture, now: float, begin: float) -> Transition:
        """Return the transition from the present motion to `motion`, which starts at `begin`."""
        return find_transition(
            self._after(now), lambda share: self._stop(now, share), motion, begin - now, self.limits
        )

    def _stream(self, trajectory: JointTrajectory, now: float, age: float) -> None:
        """Follow a streamed point that was valid `age` [s] ago."""
        zero = np.zeros(self.limits.n)
        rows = (trajectory.q, trajectory.dq, trajectory.ddq)
        q, dq, ddq = (zero if row is None else row[0] for row in rows)
        point = JointReference(q + age * (dq + 0.5 * age * ddq), dq + age * ddq, ddq)
        timeout = self.tolerances.stream_timeout - max(0.0, age)
        if timeout <= 0.0:
            raise RejectedInputError(
                f'streamed point: the point is {age:.3g} s old (stream_timeout: '
                f'{self.tolerances.stream_timeout:g}); synchronise the clocks, or set the stamp '
                'to zero ("now")'
            )
        present = self._evaluate(now)
        self._check_start(point.q, present.q)
        motion = StreamedPoint.longest(point, present, timeout, self.limits)
        self._silent_stream = 'stopped: no streamed point arrived in time'
        if motion.duration < timeout:
            self._silent_stream = (
                'stopped before a joint limit, because no further streamed point arrived'
            )
        self._replace(motion, now, now, 'streaming')

    def _goal(
        self, trajectory: JointTrajectory, now: float, begin: float
    ) -> tuple[FollowedMotion, float]:
        """Return a motion along a trajectory from `now` on, and the motion's time zero [s].

        A trajectory without an initial point starts at the present reference.
        """
        left = trajectory.times[0] - (now - begin)
        if begin <= now and left > 0.0:
            q, dq, ddq = self._after(now)(0.0)
            # One polynomial from a fast motion to a distant point would overshoot.
            stopping = float((np.abs(dq) / self.limits.acceleration_max).max())
            try:
                if not self.moves or left <= _JOINED * stopping:
                    return trajectory.path(q, now - begin, dq, ddq), begin
            except RejectedInputError:
                if not self.moves:
                    raise
        motion: PolynomialPath | Posture
        if trajectory.is_single_point:
            motion = Posture(trajectory.posture())
        else:
            motion = trajectory.path(self.reference.q)
        self._check_start(motion.evaluate(now - begin).q, self.reference.q)
        way = self._transition(motion, now, begin)
        return way, now + way.delay

    def _check_start(self, q: Array, present: Array) -> None:
        distance = np.abs(q - present)
        far = distance > self.tolerances.start
        if np.any(far):
            joint = int(np.argmax(far))
            raise RejectedInputError(
                f'trajectory: the first point is {distance[joint]:.3g} rad away from '
                f'{self.limits.names[joint]} at {present[joint]:.4g} rad (allowed '
                f'{self.tolerances.start[joint]:.3g}); start at the present position, or give '
                'the first point time to move there'
            )

    def _replace(self, motion: FollowedMotion, now: float, zero: float, status: str) -> None:
        self.end = MotionEnd.REPLACED
        self._begin(motion, now, zero, status)

    def _begin(self, motion: FollowedMotion, start: float, zero: float, status: str) -> None:
        """Replace the present motion; `zero` is the time zero of the new trajectory [s]."""
        # One assignment, because another thread may be checking a goal.
        self._under_way = motion, start
        self._zero = zero
        self._until = start + motion.duration
        self.elapsed = 0.0
        self.status = status
        self.motion += 1
        self._used = self.tolerances

    def _watch(self, q: Array, now: float) -> None:
        """End the motion at its goal, if streamed points stop, or if the arm leaves its path."""
        error, used = np.abs(self.reference.q - q), self._used
        if (error > used.path).any():
            joint = int(np.argmax(error / used.path))
            # Hold at the measured posture, so that the arm does not push against an obstacle.
            reason = f'stopped: {self.limits.names[joint]} is {error[joint]:.3g} rad off path'
            self.stop(now, reason, q)
            self.end = MotionEnd.OFF_PATH
        elif now < self._until:
            return
        elif self.status == 'streaming':
            self.status, self.end = 'holding', MotionEnd.STOPPED
            self.outcome = self._silent_stream
        elif (error <= used.goal).all():
            self.status, self.end = 'holding', MotionEnd.REACHED
            self.outcome = f'goal reached, error {error.max():.2g} rad'
        elif now > self._until + used.goal_time:
            joint = int(np.argmax(error / used.goal))
            self.status, self.end = 'holding', MotionEnd.OFF_GOAL
            self.outcome = f'goal missed: {self.limits.names[joint]} is {error[joint]:.3g} rad off'
