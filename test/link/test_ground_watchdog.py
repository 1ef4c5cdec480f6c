"""Reaction of the drone to the loss of the ground."""

from math import inf
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.link.link_ends import CONTINUE, HOME, STOP, GroundWatchdog


def watchdog(node: Node, action: str, timeout: float = 1.0) -> GroundWatchdog:
    values = SimpleNamespace(ground_timeout=timeout, ground_lost=action, config='', tf_prefix='')
    return GroundWatchdog(node, values)


@pytest.mark.parametrize('action', [CONTINUE, STOP, HOME])
def test_it_acts_once_per_cut(ros_node: Node, action: str) -> None:
    came: list[JointTrajectory | JointState] = []
    for topic in (topics.JOINT_TRAJECTORY, topics.SET_POINT):
        ros_node.create_subscription(topic.type, topic.name, came.append, topic.qos)
    dog = watchdog(ros_node, action)
    spin_until(ros_node, lambda: False, 0.5)
    for _ in range(2):
        dog.update(10.5, 10.0)
        assert dog.problem == ''
        for now in (11.1, 11.2, 60.0):
            dog.update(now, 10.0)
            assert 'the ground is silent' in dog.problem
    spin_until(ros_node, lambda: False, 0.5)
    count = {CONTINUE: 0, STOP: 2, HOME: 4}[action]
    assert len(came) == count
    assert all(not message.points for message in came if isinstance(message, JointTrajectory))
    goals = [message for message in came if isinstance(message, JointState)]
    config = load_arm_config()
    assert all(tuple(goal.position) == tuple(config.rest_position) for goal in goals)
    assert rclpy.ok()


@pytest.mark.parametrize(('timeout', 'last'), [(0.0, 10.0), (1.0, -inf)])
def test_it_does_nothing_when_off_or_before_the_first_ground(
    ros_node: Node, timeout: float, last: float
) -> None:
    dog = watchdog(ros_node, STOP, timeout)
    dog.update(1000.0, last)
    assert dog.problem == ''
