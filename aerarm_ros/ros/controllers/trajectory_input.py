"""Topics and action through which a controller receives joint trajectories and set points."""

from __future__ import annotations

from collections import deque
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Duration, Time
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory as TrajectoryMessage
from trajectory_msgs.msg import JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.control.contact_reaction import ContactReaction
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.control.references.trajectory_goals import (
    ABORTED,
    CANCELED,
    SUCCEEDED,
    GoalResult,
    ResultCode,
    TrajectoryGoals,
    resolve_tolerances,
)
from aerarm_ros.motion.signals import JointReference, Reaction
from aerarm_ros.ros.controllers.controller_node import ControllerNode
from aerarm_ros.ros.controllers.controller_parameters import (
    FOLLOWER_PARAMETERS,
    REACTION,
    REACTION_PARAMETERS,
    torque_parameters,
)
from aerarm_ros.ros.controllers.state_node import Attendant
from aerarm_ros.ros.executors import create_steady_timer
from aerarm_ros.ros.messages import seconds

TRAJECTORY_PARAMETERS = (*torque_parameters(), *FOLLOWER_PARAMETERS, *REACTION_PARAMETERS)
"""Parameters of every controller derived from `TrajectoryController`."""

# [s] A trajectory may start at most this long before and after the present time.
_MAX_BEFORE, _MAX_AFTER = 1.0, 60.0


def read_trajectory(
    limits: JointLimits,
    message: TrajectoryMessage,
    now: float,
    staying: npt.NDArray[np.float64] | None = None,
) -> tuple[JointTrajectory, float | None]:
    """Return the trajectory of a message and its start time [s], None for an immediate start.

    Parameters
    ----------
    limits, message, now
        Limits of the arm, trajectory message, and present time [s].
    staying
        Positions (n,) [rad] at which omitted joints stay. Without this argument the message must
        name all joints.

    Raises
    ------
    RejectedInputError
        If the message is not a trajectory of this arm, or its stamp lies in the past.
    """
    points = message.points
    trajectory = JointTrajectory(
        limits,
        list(message.joint_names),
        [seconds(point.time_from_start) for point in points],
        [point.positions for point in points],
        [point.velocities for point in points],
        [point.accelerations for point in points],
        staying,
    )
    stamp = seconds(message.header.stamp)
    if stamp and not -_MAX_BEFORE <= stamp - now <= _MAX_AFTER:
        raise RejectedInputError(
            f'trajectory rejected, because its stamp differs by {stamp - now:+.1f} s from the time '
            f'of the joint states (allowed: {-_MAX_BEFORE:+g} to {_MAX_AFTER:+g} s): set the stamp '
            'to zero to start at once, or check the clocks'
        )
    return trajectory, stamp or None


NAME = 'follow_joint_trajectory'
_FEEDBACK_PERIOD = 0.05  # [s]
_BILLION = 1_000_000_000


class TrajectoryController(ControllerNode):
    """Base class of controllers that follow joint trajectories and set points.

    Attributes
    ----------
    reaction
        Reaction to contact, which `subscribe` creates.
    """

    follower: TrajectoryFollower
    reaction: ContactReaction

    def make_follower(self) -> TrajectoryFollower:
        """Return the follower of trajectories and set points."""
        return self.arm.follower(self.values)

    def ahead(self, times: npt.NDArray[np.float64]) -> JointReference | None:
        """Return the planned references at times (M,) [s]."""
        return self.follower.ahead(times)

    def subscribe(self) -> None:
        """Subscribe to trajectories, set points and payload, and serve the trajectory action."""
        self.reaction = self.react_to_contact(self.follower, self.law)

        def set_point(message: JointState, now: float) -> None:
            names, rows = list(message.name), [message.position]
            goal = JointTrajectory(self.follower.limits, names, [0.0], rows, what='set point')
            self.follower.go_to(goal.q[0], now)

        self.take_references(topics.JOINT_TRAJECTORY, self._on_trajectory)
        self.take_references(topics.SET_POINT, set_point)
        self._serve_trajectories()
        self.publish_plan(self.ahead)
        self.take_payload()

    def read(self, message: TrajectoryMessage, now: float) -> tuple[JointTrajectory, float | None]:
        """Return a message's trajectory and start time, as the function `read_trajectory` does."""
        return read_trajectory(self.follower.limits, message, now, self.follower.reference.q)

    def on_parameter(self, name: str, value: Any) -> None:
        """Change the reaction to contact, or an attribute of the law."""
        if name == REACTION:
            self.reaction.reaction = Reaction(value)
        else:
            super().on_parameter(name, value)

    def describe(self) -> dict[str, object]:
        """Return the state of the present and of the last motion, for /diagnostics."""
        motion = {'motion': self.follower.status, 'last motion': self.follower.outcome}
        return {**super().describe(), **motion}

    def _on_trajectory(self, message: TrajectoryMessage, now: float) -> None:
        """Start a trajectory; a trajectory without points stops the arm."""
        if not message.points:
            self.follower.stop(now, 'stopped: empty trajectory')
            return
        trajectory, start = self.read(message, now)
        if trajectory.is_single_point:
            self.reaction.check_stream()
        self.follower.follow(trajectory, now, start)

    def _serve_trajectories(self) -> None:
        """Serve the action `~/follow_joint_trajectory` if control_msgs is installed."""
        if find_spec('control_msgs') is None:
            self.node.get_logger().info(
                f'control_msgs is not installed, so the action ~/{NAME} is not available: install '
                'ros-jazzy-control-msgs, or send trajectories on the topic joint_trajectory'
            )
            return
        action_type = import_module('control_msgs.action').FollowJointTrajectory
        self.attend(TrajectoryAction(self, action_type))


class TrajectoryAction(Attendant):
    """Action server for joint trajectories.

    `TrajectoryGoals` starts, watches and ends the goals in the loop's thread. The server answers
    its clients in the executor's thread.

    Parameters
    ----------
    controller
        Controller, whose follower executes the goals.
    action_type
        control_msgs/action/FollowJointTrajectory.
    """

    def __init__(self, controller: TrajectoryController, action_type: Any) -> None:
        self._controller = controller
        self._follower = controller.follower
        self._type = action_type
        self._goals = TrajectoryGoals(self._follower, self._end)
        self._own = self._follower.tolerances
        # Goals without a result, and goals that have ended with a result, by their ids.
        self._waiting: dict[Any, tuple[Any, Future]] = {}
        self._ended: deque[tuple[Any, GoalResult]] = deque()
        node = controller.node
        self._news = node.create_guard_condition(self._set_results)
        self._timer = create_steady_timer(
            node, _FEEDBACK_PERIOD, self._publish_feedback, autostart=False
        )
        self._server = ActionServer(
            node,
            action_type,
            f'~/{NAME}',
            self._execute,
            goal_callback=self._judge,
            cancel_callback=self._cancel,
        )

    # In the loop's thread.

    def update(self) -> None:
        """End the goal if the follower has reached or aborted its trajectory."""
        self._goals.update()

    def give_up(self, reason: str) -> None:
        """Abort the active goal, because the arm is no longer controlled."""
        self._goals.give_up(reason)

    def destroy(self) -> None:
        """Destroy the server after the loop has ended."""
        self._server.destroy()

    def _start(self, handle: Any, now: float) -> None:
        try:
            self._controller.require_commandable(NAME)
            trajectory, start = self._controller.read(handle.request.trajectory, now)
            self._goals.start(_id(handle), trajectory, now, start, self._tolerances(handle))
        except RejectedInputError as error:
            self._end(_id(handle), GoalResult(ABORTED, ResultCode.INVALID_GOAL, str(error)))
            raise

    def _tolerances(self, handle: Any) -> FollowerTolerances:
        request = handle.request
        try:
            return resolve_tolerances(
                self._own,
                self._follower.limits.names,
                [(tolerance.name, tolerance.position) for tolerance in request.path_tolerance],
                [(tolerance.name, tolerance.position) for tolerance in request.goal_tolerance],
                seconds(request.goal_time_tolerance),
            )
        except RejectedInputError as error:
            # joint_trajectory_controller also uses the default tolerances in this case.
            self._controller.reject(f'{error}; the controller uses its default tolerances')
            return self._own

    def _end(self, goal: Any, result: GoalResult) -> None:
        self._ended.append((goal, result))
        self._news.trigger()

    # In the executor's thread.

    def _judge(self, request: Any) -> GoalResponse:
        try:
            self._controller.require_commandable(NAME)
            if not request.trajectory.points:
                raise RejectedInputError(
                    f'{NAME} rejected, because the trajectory has no points: add at least one point'
                )
            if request.multi_dof_trajectory.points:
                raise RejectedInputError(
                    f'{NAME} rejected, because multi_dof_trajectory contains points: leave this '
                    'field empty'
                )
            now = self._controller.stamp_ns / _BILLION
            # The goal is checked with the present state, and again when the loop starts it.
            trajectory, start = self._controller.read(request.trajectory, now)
            self._follower.check_goal(trajectory, now, start)
        except RejectedInputError as error:
            self._controller.reject(str(error))
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _cancel(self, handle: Any) -> CancelResponse:
        self._controller.act(lambda now: self._goals.cancel(_id(handle), now))
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        result: Future = Future()
        self._waiting[_id(handle)] = handle, result
        self._controller.act(lambda now: self._start(handle, now))
        self._timer.reset()
        ended: GoalResult = await result
        end = {SUCCEEDED: handle.succeed, ABORTED: handle.abort, CANCELED: handle.canceled}
        end[ended.state]()
        self._controller.node.get_logger().info(f'{NAME}: {ended.state}: {ended.text}')
        return self._type.Result(error_code=int(ended.code), error_string=ended.text)

    def _set_results(self) -> None:
        while self._ended:
            goal, result = self._ended.popleft()
            if goal in self._waiting:
                self._waiting.pop(goal)[1].set_result(result)
        if not self._waiting:
            self._timer.cancel()

    def _publish_feedback(self) -> None:
        goal, state = self._goals.active, self._controller.state
        if goal not in self._waiting or state is None:
            return
        reference, stamp_ns = self._follower.reference, self._controller.stamp_ns
        stamp = Time(sec=stamp_ns // _BILLION, nanosec=stamp_ns % _BILLION)
        feedback = self._type.Feedback(
            header=Header(stamp=stamp),
            joint_names=list(self._follower.limits.names),
            desired=_point(reference.q, reference.dq, reference.ddq, self._follower.elapsed),
            actual=_point(state.q, state.dq),
            error=_point(reference.q - state.q, reference.dq - state.dq),
        )
        self._waiting[goal][0].publish_feedback(feedback)


def _id(handle: Any) -> bytes:
    return bytes(handle.goal_id.uuid)


def _point(q: Any, dq: Any, ddq: Any = (), elapsed: float = 0.0) -> JointTrajectoryPoint:
    elapsed_ns = max(0, round(elapsed * _BILLION))
    return JointTrajectoryPoint(
        positions=list(q),
        velocities=list(dq),
        accelerations=list(ddq),
        time_from_start=Duration(sec=elapsed_ns // _BILLION, nanosec=elapsed_ns % _BILLION),
    )
