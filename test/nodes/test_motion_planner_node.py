"""The planner as a process, with states and goals from the test."""

import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from forked_executable import run
from geometry_msgs.msg import PointStamped
from quick_spinning import answer_of, spin_once
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.ros.controllers.trajectory_input import read_trajectory
from aerarm_ros.ros.process.node_process import NodeProcess

START, GOAL = np.array([0.2, 1.0, 0.0, 0.3]), [-0.6, 2.2, 0.5, -0.2]
PLACE = [0.3, 0.35, 0.65]
ASKED = [7, 5]  # stamp of a goal: [s], [ns]
NAMES = load_arm_config().joint_names


class Desk:
    """Publish states and goals for a planner, and receive its results."""

    def __init__(self, node: Node, process: NodeProcess) -> None:
        self.node, self.process = node, process
        self.dq = np.zeros(4)
        self.told: list[dict] = []
        self.sent: list = []
        self._codec = JointStateCdr(NAMES)
        self._publishers = {
            topic.name: node.create_publisher(topic.type, topic.name, topic.qos)
            for topic in (topics.JOINT_STATES, topics.JOINT_GOAL, topics.TOOL_GOAL)
        }
        topic = topics.PLAN_STATUS
        node.create_subscription(
            topic.type, topic.name, lambda m: self.told.append(json.loads(m.data)), topic.qos
        )
        topic = topics.JOINT_TRAJECTORY
        node.create_subscription(topic.type, topic.name, self.sent.append, topic.qos)
        self.wait(
            lambda: all(p.get_subscription_count() for p in self._publishers.values()), 'planner'
        )

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        deadline, stamp = time.monotonic() + 120.0, 10**9
        while not condition():
            stamp += 10_000_000
            states = self._publishers[topics.JOINT_STATES.name]
            states.publish(self._codec.pack(stamp, START, self.dq, np.zeros(4)))
            spin_once(self.node, 0.02)
            assert self.process.returncode is None, self.process.tail()
            assert time.monotonic() < deadline, f'waited for {what}: {self.told}'

    def ask(self, topic: topics.Topic, message: object) -> dict:
        """Return the planner's result for a goal."""
        told, sent = len(self.told), len(self.sent)
        self._publishers[topic.name].publish(message)
        self.wait(lambda: len(self.told) > told, 'an answer')
        if self.told[-1]['accepted']:
            self.wait(lambda: len(self.sent) > sent, 'a trajectory')
        else:
            assert len(self.sent) == sent
        return self.told[-1]

    def set(self, name: str, value: float | list[float]) -> bool:
        """Return whether a parameter was set."""
        client = self.node.create_client(SetParameters, 'motion_planner/set_parameters')
        assert client.wait_for_service(60.0)
        parameters = [Parameter(name, value=value).to_parameter_msg()]
        request = SetParameters.Request(parameters=parameters)
        answer = answer_of(self.node, lambda: client.call_async(request), 60.0)
        return bool(answer.results[0].successful)


@pytest.fixture
def desk(ros_node: Node, tmp_path: Path) -> Iterator[Desk]:
    with NodeProcess('motion_planner', log=tmp_path / 'log') as process:
        yield Desk(ros_node, process)


def test_goals_of_joints_and_tool_become_trajectories_or_one_line(desk: Desk) -> None:
    limits = JointLimits.from_config(load_arm_config())
    shuffled = [2, 0, 3, 1]
    goal = JointState(name=[NAMES[i] for i in shuffled], position=[GOAL[i] for i in shuffled])
    goal.header.stamp.sec, goal.header.stamp.nanosec = ASKED
    answer = desk.ask(topics.JOINT_GOAL, goal)
    assert (answer['asked'], answer['trajectory']) == (ASKED, [0, 0])
    assert (answer['accepted'], answer['seconds']) == (True, 2.0), answer
    trajectory, start = read_trajectory(limits, desk.sent[-1], 0.0)
    assert start is None
    path = trajectory.path(START)
    np.testing.assert_allclose(path.evaluate(0.0).q, START, atol=1e-9)
    np.testing.assert_allclose(path.evaluate(2.0).q, GOAL, atol=1e-9)

    point = PointStamped()
    point.point.x, point.point.y, point.point.z = PLACE
    answer = desk.ask(topics.TOOL_GOAL, point)
    tool = Kinematics(load_robot(), 'tool0').position(np.array(answer['goal']))
    np.testing.assert_allclose(tool, PLACE, atol=1e-3)

    assert desk.set('lead', 0.5)
    answer = desk.ask(topics.JOINT_GOAL, goal)
    stamp = desk.sent[-1].header.stamp
    assert answer['trajectory'] == [stamp.sec, stamp.nanosec] != [0, 0]

    assert desk.set('duration', 0.2)
    refused = desk.ask(topics.JOINT_GOAL, goal)
    assert (refused['accepted'], refused['asked']) == (False, ASKED)
    assert 'a motion of 0.2 s is infeasible' in refused['text']
    assert 'the fastest motion takes' in refused['text']
    point.header.frame_id = 'camera'
    assert "its frame is 'camera'" in desk.ask(topics.TOOL_GOAL, point)['text']
    assert 'set 4 positions' in desk.ask(topics.JOINT_GOAL, JointState(name=NAMES))['text']
    assert 'elbow' in desk.ask(topics.JOINT_GOAL, JointState(name=['elbow']))['text']
    assert not desk.set('payload.inertial_parameters', [-1.0, *[0.0] * 9])  # of no body
    desk.dq = np.array([0.0, 0.3, 0.0, 0.0])
    desk.wait(
        lambda: 'the arm moves at 0.30 rad/s' in desk.ask(topics.JOINT_GOAL, goal)['text'], 'motion'
    )


def test_a_tool_that_the_arm_has_not_is_refused_at_the_start(ros_domain: dict[str, str]) -> None:
    refused = run('motion_planner', parameters={'frame': 'hand'})
    assert refused.returncode == 1
    assert "motion_planner: unknown link 'hand': choose one of" in refused.stderr
    assert len(refused.stderr.splitlines()) == 1
