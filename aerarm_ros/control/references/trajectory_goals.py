"""Trajectory goals of an action server; at most one goal is active at a time."""

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import replace
from enum import IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import (
    FollowerTolerances,
    MotionEnd,
    TrajectoryFollower,
)

# Values of control_msgs: the follower's own tolerance, and no tolerance.
_DEFAULT, _NONE = 0.0, -1.0


def resolve_tolerances(
    own: FollowerTolerances,
    names: Sequence[str],
    path: Iterable[tuple[str, float]] = (),
    goal: Iterable[tuple[str, float]] = (),
    goal_time: float = _DEFAULT,
) -> FollowerTolerances:
    """Return the tolerances of a goal, by the rules of ROS 2's joint_trajectory_controller.

    Zero means the follower's own value, -1 no check.

    Parameters
    ----------
    own
        Tolerances of the follower.
    names
        The arm's n joints.
    path, goal
        Joints and their tolerances [rad], if they differ from the follower's.
    goal_time
        Time [s] after the end of the motion within which the goal must be reached.

    Raises
    ------
    RejectedInputError
        If a joint does not belong to the arm, or a value is neither positive nor 0 nor -1.
    """
    time = _resolve('goal_time_tolerance', own.goal_time, goal_time)
    return replace(
        own,
        path=_resolve_each('path_tolerance', own.path, names, path),
        goal=_resolve_each('goal_tolerance', own.goal, names, goal),
        goal_time=time,
    )


def _resolve_each(
    what: str,
    own: npt.NDArray[np.float64],
    names: Sequence[str],
    given: Iterable[tuple[str, float]],
) -> npt.NDArray[np.float64]:
    resolved = own.copy()
    for name, value in given:
        if name not in names:
            raise RejectedInputError(
                f'{what}: the arm has no joint {name!r}; check the joint names'
            )
        joint = list(names).index(name)
        resolved[joint] = _resolve(f'{what} of {name}', own[joint], value)
    return resolved


def _resolve(what: str, own: float, value: float) -> float:
    if value == _DEFAULT:
        return own
    if value == _NONE:
        return np.inf
    if not 0.0 < value < np.inf:
        raise RejectedInputError(
            f'{what} = {value:g}: set a positive number, 0 for the default or -1 for no tolerance'
        )
    return value


SUCCEEDED, ABORTED, CANCELED = 'succeeded', 'aborted', 'canceled'


class ResultCode(IntEnum):
    """Error codes of FollowJointTrajectory, as joint_trajectory_controller uses them."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class GoalResult(NamedTuple):
    """Result of a goal: status SUCCEEDED, ABORTED or CANCELED, error code and text."""

    state: str
    code: ResultCode
    text: str


_RESULTS = {
    MotionEnd.REACHED: (SUCCEEDED, ResultCode.SUCCESSFUL),
    MotionEnd.OFF_PATH: (ABORTED, ResultCode.PATH_TOLERANCE_VIOLATED),
    MotionEnd.OFF_GOAL: (ABORTED, ResultCode.GOAL_TOLERANCE_VIOLATED),
    MotionEnd.REPLACED: (ABORTED, ResultCode.INVALID_GOAL),
    MotionEnd.STOPPED: (ABORTED, ResultCode.INVALID_GOAL),
}


class TrajectoryGoals:
    """Starts and cancels trajectory goals, and reports their results.

    A new goal replaces the active one, and so does any other motion of the follower, for example
    from a topic. A goal that cannot start leaves the active one unchanged.

    Parameters
    ----------
    follower : TrajectoryFollower
        Follower of the goals; its owner updates it.
    on_end : callable
        Receives each goal that has ended, with its result.

    Attributes
    ----------
    active : Hashable or None
        The active goal.
    """

    def __init__(
        self, follower: TrajectoryFollower, on_end: Callable[[Hashable, GoalResult], None]
    ) -> None:
        self.active: Hashable | None = None
        self._follower = follower
        self._on_end = on_end
        self._motion = 0

    def start(
        self,
        goal: Hashable,
        trajectory: JointTrajectory,
        now: float,
        start: float | None = None,
        tolerances: FollowerTolerances | None = None,
    ) -> None:
        """Start a goal, which replaces the active one.

        Parameters
        ----------
        goal : Hashable
            Identifier of the goal.
        trajectory, now, start, tolerances
            Arguments of `TrajectoryFollower.follow`.

        Raises
        ------
        RejectedInputError
            If the goal cannot start; nothing has changed then.
        """
        self._follower.follow(trajectory, now, start, tolerances, is_goal=True)
        self.give_up('another goal replaced this one')
        self.active, self._motion = goal, self._follower.motion

    def cancel(self, goal: Hashable, now: float) -> None:
        """Stop the arm if this goal is active."""
        if goal == self.active:
            self._follower.stop(now, 'stopped: the goal was canceled')
            self._end(GoalResult(CANCELED, ResultCode.SUCCESSFUL, 'canceled'))

    def give_up(self, reason: str) -> None:
        """Abort the active goal, for example because the controller stops."""
        self._end(GoalResult(ABORTED, ResultCode.INVALID_GOAL, reason))

    def update(self) -> None:
        """End the active goal if the follower's last update ended its motion."""
        follower = self._follower
        is_same = follower.motion == self._motion
        if self.active is None or (is_same and follower.status != 'holding'):
            return
        state, code = _RESULTS[follower.end]
        text = follower.end.value if follower.end is MotionEnd.REPLACED else follower.outcome
        self._end(GoalResult(state, code, text))

    def _end(self, result: GoalResult) -> None:
        if self.active is not None:
            ended, self.active = self.active, None
            self._on_end(ended, result)
