"""Plan optimal motions from the arm's present posture to goals, and send them to the controller.

A goal is a `sensor_msgs/JointState` with joint positions on `joint_goal`, or a
`geometry_msgs/PointStamped` with the position of the tool on `tool_goal`. The node publishes the
planned motion on `joint_trajectory`. It publishes the result of planning on `plan_status`, as a
JSON object with the stamps of goal and trajectory.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.planner.motion_plan import ENERGY, OBJECTIVES, MotionPlan, PlanError, PlanSettings
from aerarm_ros.planner.motion_planner import MotionPlanner
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.controllers.controller_parameters import (
    MODEL_PARAMETERS,
    PAYLOAD,
    load_share,
    payload_problem,
)
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import (
    ARM_FILES,
    SURROUNDINGS,
    load_arm,
    load_setup,
)
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.process.process_end import StopSignals
from aerarm_ros.ros.requests.motion_request import trajectory_message
from aerarm_ros.ros.states.state_stream import StateSampler

_SETTINGS = (
    Parameter('objective', ENERGY,
        'objective of the optimization: energy or time; quintic is a straight line in joint space '
        'without optimization, for comparison', choices=OBJECTIVES, live=True),
    Parameter('duration', 2.0,
        'duration of each motion; 0 for the optimal duration', 's', 0.0, 60.0, live=True),
    Parameter('time_price', 10.0,
        'cost per second of motion, used if duration is 0; for example the hover power of the '
        'drone',
        'W', 0.0, 1e5, live=True),
    Parameter('smoothness', 0.03, (
        'weight of the squared joint accelerations in the objective, scaled by inertia for '
        'light joints; it makes joints whose motion costs no energy move evenly'
    ),
              'J s^3/rad^2', 0.0, 100.0, live=True),
    Parameter('velocity_share', 0.9,
        'fraction of the velocity and acceleration limits that a motion may use', '', 0.01,
              1.0, live=True),
    Parameter('effort_share', 0.8,
        'fraction of the torque and current limits that a motion may use', '', 0.01, 1.0,
              live=True),
)  # fmt: skip

PLANNER_PARAMETERS = (
    *_SETTINGS,
    Parameter('frame', 'tool0', 'link whose position a tool goal specifies'),
    Parameter('hold_time', 5.0,
        'expected time for which the arm will hold a tool goal; for a longer time the planner '
        'prefers goal postures with little holding torque',
        's', 0.0, 3600.0, live=True),
    Parameter('lead', 0.0,
        'time from the newest joint state to the start of the motion; 0 to start the motion when '
        'the controller receives it',
              's', 0.0, 10.0, live=True),
    *MODEL_PARAMETERS,
    *ARM_FILES,
    *SURROUNDINGS,
)  # fmt: skip


def plan_settings(values: SimpleNamespace) -> dict[str, object]:
    """Return the arguments of `PlanSettings` from the node's parameters."""
    return {parameter.name: getattr(values, parameter.name) for parameter in _SETTINGS}


NAME = 'motion_planner'
PARAMETERS = ParameterTable(*PLANNER_PARAMETERS)

_PERIOD = 0.02  # [s] between two checks for a new goal
_REST_SPEED = 0.05  # [rad/s] a faster joint moves


class MotionPlannerNode:
    """Node that receives goals, plans motions with `MotionPlanner`, and publishes trajectories.

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
        Kinematics(robot, self._values.frame)  # raises if the arm has no such link
        self._limits = JointLimits.from_config(config)
        self._base = robot.base_link
        self._names = config.joint_names
        self._planner = self._make_planner(config, robot)
        self._state: Array | None = None
        self._asked = Time()  # stamp of the goal for which a motion is being planned
        self._states = StateSampler(self._node, self._names)
        self._trajectories, self._status_publisher = (
            topic.publisher(self._node) for topic in (topics.JOINT_TRAJECTORY, topics.PLAN_STATUS)
        )
        for topic, take in (
            (topics.JOINT_GOAL, self._on_joint_goal),
            (topics.TOOL_GOAL, self._on_tool_goal),
        ):
            topic.subscription(self._node, partial(self._later, take))
        self._loop = PeriodicLoop(_PERIOD)

    def _make_planner(self, config: ArmConfig, robot: Robot) -> MotionPlanner:
        values = self._values
        model = EnergyModel(config, robot, values.rotor_inertia or None, load_share(values, robot))
        settings: Any = plan_settings(values)
        planner = MotionPlanner(model, load_setup(values, config, robot), PlanSettings(**settings))
        if payload := getattr(values, PAYLOAD):
            planner.carry(payload)
        return planner

    def run(self) -> None:
        """Plan motions until the process receives a stop signal."""
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
            raise PlanError(
                f'joint goal rejected, because it has {len(message.position)} positions: set '
                f'{self._limits.n} positions, one per joint'
            )
        goal = np.array(message.position)[self._limits.order(list(message.name))]
        self._send(self._planner.plan(self._start(), goal))

    def _on_tool_goal(self, message: PointStamped) -> None:
        frame = message.header.frame_id
        if frame not in ('', self._base):
            raise PlanError(
                f'tool goal rejected, because its frame is {frame!r}: send the goal in the frame '
                f'{self._base!r}'
            )
        point, values = message.point, self._values
        place = [point.x, point.y, point.z]
        planner = self._planner
        self._send(planner.plan_tool(self._start(), place, values.frame, values.hold_time))

    def _start(self) -> Array:
        # Read a joint state newer than the goal, because clients send a goal after the arm has come
        # to rest.
        newest = self._states.newest()
        self._state = self._state if newest is None else newest
        if self._state is None:
            missing = ', '.join(self._states.missing)
            raise PlanError(
                f'joint_states lacks the joints {missing}: check the parameters config and '
                'tf_prefix'
                if missing
                else 'no joint_states received: start the bridge'
            )
        q, dq, _ = self._state
        speed = float(np.nanmax(np.abs(dq), initial=0.0))
        if speed > _REST_SPEED:
            raise PlanError(
                f'goal rejected, because the arm moves at {speed:.2f} rad/s and a planned motion '
                'starts from rest: send the goal again when the arm rests'
            )
        return np.array(q)

    def _send(self, plan: MotionPlan) -> None:
        self._states.newest()  # the newest stamp after planning
        lead_ns = round(self._values.lead * 1e9)
        begin_ns = self._states.stamp_ns + lead_ns if lead_ns else 0
        message = trajectory_message(plan.path, self._names, begin_ns)
        self._trajectories.publish(message)
        stamp = message.header.stamp
        self._publish_status(
            accepted=True,
            text=plan.as_text(),
            trajectory=[stamp.sec, stamp.nanosec],
            seconds=plan.path.duration,
            joules=float(plan.balance.motors.sum()),
            goal=plan.goal.tolist(),
        )
        self._node.get_logger().info(plan.as_text())

    def _refuse(self, reason: str) -> None:
        self._publish_status(accepted=False, text=reason)
        self._node.get_logger().warning(f'no motion planned: {reason}')

    def _publish_status(self, **values: object) -> None:
        status = {'asked': [self._asked.sec, self._asked.nanosec], **values}
        self._status_publisher.publish(String(data=json.dumps(status)))

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
