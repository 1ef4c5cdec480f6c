"""Plans motions from where the arm is to goals, and sends them to the controller.

A goal is a `sensor_msgs/JointState` with positions on `joint_goal`, or a
`geometry_msgs/PointStamped`, where the tool shall be, on `tool_goal`. Out goes a
`joint_trajectory`; `plan_status` tells what came of the goal, as a JSON object: which goal and
which trajectory by the stamps of both.
"""

from __future__ import annotations

import json
import sys
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.planner.motion_plan import MotionPlan
from aerarm_ros.planner.plan_error import PlanError
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD, payload_problem
from aerarm_ros.ros.controllers.planner_parameters import (
    PLANNER_PARAMETERS,
    make_planner,
    plan_settings,
)
from aerarm_ros.ros.controllers.trajectory_output import trajectory_message
from aerarm_ros.ros.executors.background_executor import BackgroundExecutor
from aerarm_ros.ros.parameters.arm_files import load_arm
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.stop_signals import StopSignals
from aerarm_ros.ros.states.state_sampler import StateSampler

NAME = 'motion_planner'
PARAMETERS = ParameterTable(*PLANNER_PARAMETERS)

_PERIOD = 0.02  # [s] between two looks for a goal
_AT_REST = 0.05  # [rad/s]


class MotionPlannerNode:
    """Goals in, a `MotionPlanner`, trajectories out.

    Attributes
    ----------
    status
        Exit status after `run`.

    Raises
    ------
    ValueError
        If a parameter or a file cannot be used.
    """

    def __init__(self) -> None:
        self.status = 0
        self._node = rclpy.create_node(NAME)
        self._requests: deque[Callable[[], None]] = deque()
        self._values = PARAMETERS.declare(self._node, self._on_parameter, payload_problem)
        config, robot = load_arm(self._values)
        Kinematics(robot, self._values.frame)  # refuses a link that the arm has not
        self._limits = JointLimits.from_config(config)
        self._base = robot.base_link
        self._names = config.joint_names
        self._planner = make_planner(self._values, config, robot)
        self._state: FloatArray | None = None
        self._asked = Time()  # stamp of the goal that is planned for
        self._states = StateSampler(self._node, self._names)
        self._trajectories, self._told = (
            self._node.create_publisher(topic.type, topic.name, topic.offered)
            for topic in (topics.JOINT_TRAJECTORY, topics.PLAN_STATUS)
        )
        for topic, take in (
            (topics.JOINT_GOAL, self._on_joint_goal),
            (topics.TOOL_GOAL, self._on_tool_goal),
        ):
            self._node.create_subscription(
                topic.type, topic.name, partial(self._later, take), topic.qos
            )
        self._loop = PeriodicLoop(_PERIOD)

    def run(self) -> None:
        """Plan until stopped."""
        with StopSignals(self._loop.stop), BackgroundExecutor(self._node):
            self._loop.run(self._update)

    def close(self) -> None:
        """Destroy the node."""
        self._states.destroy()
        self._node.destroy_node()

    def _update(self, now_ns: int, index: int) -> None:
        while self._requests:
            self._requests.popleft()()

    def _on_joint_goal(self, message: JointState) -> None:
        self._limits.order(list(message.name))
        if len(message.position) != self._limits.n:
            raise PlanError(f'joint goal: it needs {self._limits.n} positions')
        goal = np.array(message.position)[self._limits.order(list(message.name))]
        self._send(self._planner.plan(self._start(), goal))

    def _on_tool_goal(self, message: PointStamped) -> None:
        frame = message.header.frame_id
        if frame not in ('', self._base):
            raise PlanError(f'tool goal: it is given in {frame!r}, send it in {self._base!r}')
        point, values = message.point, self._values
        place = [point.x, point.y, point.z]
        planner = self._planner
        self._send(planner.plan_tool(self._start(), place, values.frame, values.hold_time))

    def _start(self) -> FloatArray:
        # Now, after the goal has come: who asks has seen the arm at rest.
        newest = self._states.newest()
        self._state = self._state if newest is None else newest
        if self._state is None:
            missing = ', '.join(self._states.missing)
            raise PlanError(
                f'joint_states lacks {missing}: check config and tf_prefix'
                if missing
                else 'no joint_states have come: start the bridge'
            )
        q, dq, _ = self._state
        speed = float(np.nanmax(np.abs(dq), initial=0.0))
        if speed > _AT_REST:
            raise PlanError(f'the arm moves at {speed:.2f} rad/s: motions are planned from rest')
        return np.array(q)

    def _send(self, plan: MotionPlan) -> None:
        self._states.newest()  # time has passed while it was planned
        lead_ns = round(self._values.lead * 1e9)
        begin_ns = self._states.stamp_ns + lead_ns if lead_ns else 0
        message = trajectory_message(plan.path, self._names, begin_ns)
        self._trajectories.publish(message)
        stamp = message.header.stamp
        self._tell(
            accepted=True,
            text=plan.as_text(),
            trajectory=[stamp.sec, stamp.nanosec],
            seconds=plan.path.duration,
            joules=float(plan.balance.motors.sum()),
            goal=plan.goal.tolist(),
        )
        self._node.get_logger().info(plan.as_text())

    def _refuse(self, reason: str) -> None:
        self._tell(accepted=False, text=reason)
        self._node.get_logger().warning(f'no plan: {reason}')

    def _tell(self, **values: object) -> None:
        status = {'asked': [self._asked.sec, self._asked.nanosec], **values}
        self._told.publish(String(data=json.dumps(status)))

    # Callbacks, in the executor's thread.

    def _later(self, take: Callable[[Any], None], message: Any) -> None:
        def act() -> None:
            self._asked = message.header.stamp
            try:
                take(message)
            except (PlanError, RejectedInputError) as error:
                self._refuse(str(error))

        self._requests.append(act)

    def _on_parameter(self, name: str, value: Any) -> None:
        def change() -> None:
            if name == PAYLOAD:
                self._planner.carry(value or [0.0] * 10)
            else:
                setattr(self._values, name, value)
                self._planner = self._planner.with_settings(**plan_settings(self._values))

        self._requests.append(change)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, MotionPlannerNode, args, PARAMETERS, __doc__)


if __name__ == '__main__':
    sys.exit(main())
