"""Executes trajectories, set points and streamed references in time."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import JointLimits, RejectedInputError, non_negative, positive
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
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
    """Reason for the end of a motion."""

    REACHED = 'the motion reached its goal'
    OFF_PATH = 'the arm left the tolerance around its path'
    OFF_GOAL = 'the arm was outside the goal tolerance when the time was over'
    REPLACED = 'another motion replaced this one'
    STOPPED = 'the motion was stopped, or the controller was reset'


@dataclass(frozen=True, eq=False)
class FollowerTolerances:
    """Tolerances of n joints, and times.

    Attributes
    ----------
    start : (n,) ndarray
        Distance [rad] of a trajectory's first point from the present reference.
    path : (n,) ndarray
        Error [rad] under way beyond which the motion is aborted; positive, infinite for no check.
    goal : (n,) ndarray
        Error [rad] at which the goal counts as reached; positive, infinite for no check.
    goal_time : float
        Time [s] after the end to reach the goal.
    stream_timeout : float
        Silence [s] after which a streamed reference brakes.
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
        """Return the same tolerances for each of n joints.

        Raises
        ------
        ValueError
            If a value isn't positive.
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


# Times that the limits need to stop, up to which a trajectory's first point is reached without.
_JOINED = 3.0


class TrajectoryFollower:
    """Follows trajectories and streamed points; references are continuous up to the acceleration.

    A new motion replaces the running one at any time, on a way that keeps to the limits (see
    `find_transition`). A stop follows the path of the motion under way, see `stop_along`; on a
    stream, whose path is not known, each joint brakes. After its end, and after an abort, the arm
    holds. Times are injected [s], of any steady clock.

    Parameters
    ----------
    limits : JointLimits
    tolerances : FollowerTolerances
    interpolation : str
        'cubic' or 'quintic', for trajectories.
    govern : callable
        Returns a motion as it is executed, its path at a lower pace where that is needed; it may
        reject it (RejectedInputError). Streamed points and stops are not governed.

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
        govern: Callable[[FollowedMotion], FollowedMotion] = lambda motion: motion,
    ) -> None:
        self._govern = govern
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
        self._silent_stream = ''  # how a stream ends after which nothing comes
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
            self.outcome, self.end = 'stopped: the controller was reset', MotionEnd.STOPPED
        self.reference = JointReference.at_rest(q)
        self._begin(Posture(self.reference), 0.0, 0.0, 'holding')

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
            If it starts too far from the present reference or leaves the limits, between its
            points or on the way to it.
        """
        begin = now if start is None else start
        if trajectory.is_single_point and not is_goal:
            self._stream(trajectory, now, now - begin)
        else:
            motion, zero = self._goal(trajectory, now, begin)
            self._replace(self._govern(motion), now, zero, 'moving')
        self._used = tolerances or self._tolerances

    def check_goal(
        self, trajectory: JointTrajectory, now: float, start: float | None = None
    ) -> None:
        """Require that a goal could begin now; nothing changes, and any thread may call it.

        Arguments as of `follow`. Raises RejectedInputError as that does.
        """
        self._goal(trajectory, now, now if start is None else start)

    def go_to(self, q: Array, now: float) -> None:
        """Go to rest at `q` (n,) [rad] on a quintic that uses half of what limits allow.

        An arm that moves stops on its path first.

        Raises
        ------
        RejectedInputError
            If the set point is outside the limits.
        """
        self._limits.check_position('set point', q)
        path = rest_to_rest_path(self.reference.q, q, self._limits)
        if self._moves():
            stop = self._stop(now)
            path = joined(stop, rest_to_rest_path(stop.evaluate(stop.duration).q, q, self._limits))
        self._replace(self._govern(path), now, now, 'moving')

    def stop(self, now: float, reason: str, q: Array | None = None) -> None:
        """Stop and hold: at `q` (n,) [rad], or as soon as the motion can stop on its path."""
        if q is None:
            motion: FollowedMotion = self._stop(now)
        else:
            q = np.clip(q, self._limits.position_min, self._limits.position_max)
            motion = self._transition(Posture(JointReference.at_rest(q)), now, now)
        self._replace(motion, now, now, 'holding')
        self.outcome, self.end = reason, MotionEnd.STOPPED

    def update(self, q: Array, now: float, dt: float = 0.0) -> JointReference:
        """Return the reference at `now`, with the arm measured at `q` (n,) [rad].

        `dt` isn't used: the reference is a function of time.
        """
        self.reference = self._evaluate(now)
        self._elapsed = now - self._zero
        if self.status != 'holding':
            self._watch(q, now)
        return self.reference

    def ahead(self, times: Array) -> JointReference:
        """Return the references (M, n) at times (M,) [s] from now on, if nothing new comes."""
        rows = [self._evaluate(time) for time in times.tolist()]
        return JointReference(*map(np.array, zip(*rows, strict=True)))

    def _evaluate(self, now: float) -> JointReference:
        motion, start = self._under_way
        return motion.evaluate(now - start)

    def _after(self, now: float) -> Callable[[float], JointReference]:
        """Return what gives the reference a time [s] after now, if nothing new comes."""
        motion, start = self._under_way
        return lambda time: motion.evaluate(now - start + time)

    def _moves(self) -> bool:
        return bool(np.any(self.reference.dq) or np.any(self.reference.ddq))

    def _stop(self, now: float, share: float = 1.0) -> PolynomialPath:
        """Return the stop of the motion under way, with a share of the acceleration limits."""
        acceleration_max = share * self._limits.acceleration_max
        if self.status == 'streaming':
            return brake(self._evaluate(now), acceleration_max)
        motion = self._after(now)
        return stop_along(motion, 0.0, acceleration_rows(acceleration_max)).path(motion)

    def _transition(self, motion: PolynomialPath | Posture, now: float, begin: float) -> Transition:
        """Return the way to a motion whose time zero is `begin` [s]."""
        return find_transition(
            self._after(now),
            lambda share: self._stop(now, share),
            motion,
            begin - now,
            self._limits,
        )

    def _stream(self, trajectory: JointTrajectory, now: float, age: float) -> None:
        """Follow a streamed point that was valid `age` [s] ago."""
        zero = np.zeros(self._limits.n)
        rows = (trajectory.q, trajectory.dq, trajectory.ddq)
        q, dq, ddq = (zero if row is None else row[0] for row in rows)
        point = JointReference(q + age * (dq + 0.5 * age * ddq), dq + age * ddq, ddq)
        timeout = self._tolerances.stream_timeout - max(0.0, age)
        if timeout <= 0.0:
            raise RejectedInputError(
                f'streamed point: {age:.3g} s old (stream_timeout: '
                f'{self._tolerances.stream_timeout:g}); synchronise the clocks, or set the stamp '
                'to zero ("now")'
            )
        self._check_start(point.q)
        motion = StreamedPoint.longest(point, self._evaluate(now), timeout, self._limits)
        self._silent_stream = 'stopped: no streamed point arrived in time'
        if motion.duration < timeout:
            self._silent_stream = (
                'stopped: the streamed point led to a limit, and no other followed'
            )
        self._replace(motion, now, now, 'streaming')

    def _goal(
        self, trajectory: JointTrajectory, now: float, begin: float
    ) -> tuple[FollowedMotion, float]:
        """Return what executes a trajectory from `now` on, and when its time zero is [s].

        A trajectory that does not say where it begins goes on from here.
        """
        left = trajectory.times[0] - (now - begin)
        if self.interpolation == 'quintic' and begin <= now and left > 0.0:
            q, dq, ddq = self._evaluate(now)
            # One polynomial from a fast motion to a late point would swing out.
            stopping = float((np.abs(dq) / self._limits.acceleration_max).max())
            try:
                if not self._moves() or left <= _JOINED * stopping:
                    return trajectory.path(q, 'quintic', now - begin, dq, ddq), begin
            except RejectedInputError:
                if not self._moves():
                    raise
        motion: PolynomialPath | Posture
        if trajectory.is_single_point:
            motion = Posture(trajectory.posture())
        else:
            motion = trajectory.path(self.reference.q, self.interpolation)
        self._check_start(motion.evaluate(now - begin).q)
        way = self._transition(motion, now, begin)
        return way, now + way.delay

    def _check_start(self, q: Array) -> None:
        distance = np.abs(q - self.reference.q)
        far = distance > self._tolerances.start
        if np.any(far):
            joint = int(np.argmax(far))
            raise RejectedInputError(
                f'trajectory: it starts {distance[joint]:.3g} rad away from '
                f'{self._limits.names[joint]} at {self.reference.q[joint]:.4g} rad (allowed '
                f'{self._tolerances.start[joint]:.3g}); start at the present position, or give '
                'the first point time to move there'
            )

    def _replace(self, motion: FollowedMotion, now: float, zero: float, status: str) -> None:
        self.end = MotionEnd.REPLACED
        self._begin(motion, now, zero, status)

    def _begin(self, motion: FollowedMotion, start: float, zero: float, status: str) -> None:
        """Execute a motion from `start` on; `zero` is the time zero of its trajectory [s]."""
        # One assignment: another thread may be checking a goal.
        self._under_way = motion, start
        self._zero = zero
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
            self.status, self.end = 'holding', MotionEnd.STOPPED
            self.outcome = self._silent_stream
        elif (error <= used.goal).all():
            self.status, self.end = 'holding', MotionEnd.REACHED
            self.outcome = f'goal reached, error {error.max():.2g} rad'
        elif now > self._until + used.goal_time:
            joint = int(np.argmax(error / used.goal))
            self.status, self.end = 'holding', MotionEnd.OFF_GOAL
            self.outcome = f'goal missed: {self._limits.names[joint]} {error[joint]:.3g} rad off'
