"""Reaction of the drone to the loss of the ground."""

import os
import signal
import time
from math import inf
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from controller_bench import ControllerBench, trajectory
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
def test_the_watchdog_acts_once_per_cut(ros_node: Node, action: str) -> None:
    came: list[JointTrajectory | JointState] = []
    for topic in (topics.JOINT_TRAJECTORY, topics.SET_POINT):
        topic.subscription(ros_node, came.append)
    dog = watchdog(ros_node, action)
    assert spin_until(ros_node, dog._requests.get_subscription_count, 60.0)
    for _ in range(2):
        dog.update(10.5, 10.0)
        assert dog.problem == ''
        for now in (11.1, 11.2, 60.0):
            dog.update(now, 10.0)
            assert 'the ground is silent' in dog.problem
    wanted = 0 if action == CONTINUE else 2
    spin_until(ros_node, lambda: len(came) >= wanted, 60.0)
    spin_until(ros_node, lambda: False, 0.1)
    assert len(came) == wanted
    assert all(not message.points for message in came if isinstance(message, JointTrajectory))
    goals = [message for message in came if isinstance(message, JointState)]
    config = load_arm_config()
    assert all(tuple(goal.position) == tuple(config.rest_position) for goal in goals)


@pytest.mark.parametrize(('timeout', 'last'), [(0.0, 10.0), (1.0, -inf)])
def test_the_watchdog_does_nothing_when_off_or_before_the_first_connection(
    ros_node: Node, timeout: float, last: float
) -> None:
    dog = watchdog(ros_node, STOP, timeout)
    dog.update(1000.0, last)
    assert dog.problem == ''


AWAY = [0.5, 1.2, -0.3, 0.5]


@pytest.mark.parametrize('name', ['gravity_compensation', 'computed_torque'])
def test_a_moving_arm_returns_home(tmp_path: Path, ros_node: Node, name: str) -> None:
    home = np.array(load_arm_config().rest_position)
    bench = ControllerBench(tmp_path, ros_node)
    with bench.hardware:
        bench.start()
        with bench.controller(name) as process:
            trajectories = bench.publisher(topics.JOINT_TRAJECTORY)
            dog = watchdog(ros_node, HOME)
            bench.wait(lambda: bench.mode == 'running', 'commands')
            bench.wait(lambda: not dog.warning(), 'discovery')
            trajectories.publish(trajectory(AWAY, 3.0))
            bench.wait(lambda: np.abs(bench.dq).max() > 0.1, 'a motion')
            # A busy controller may find several messages at once, and read them in any order.
            os.kill(process.pid, signal.SIGSTOP)
            dog.update(10.0, 0.0)
            time.sleep(0.2)
            os.kill(process.pid, signal.SIGCONT)
            assert dog.problem.endswith('the arm returns to its home configuration')
            bench.wait(lambda: np.abs(bench.q - home).max() < 0.02, 'home')
            assert bench.mode == 'running'


@pytest.mark.parametrize('action', [STOP, HOME])
def test_a_controller_that_ignores_the_request_is_named(ros_node: Node, action: str) -> None:
    command = topics.JOINT_COMMAND
    dog = watchdog(ros_node, action)
    assert dog.warning() == ''
    ros_node.create_publisher(command.type, command.name, command.offered)
    spin_until(ros_node, lambda: bool(dog.warning()), 5.0)
    topic = {STOP: 'joint_trajectory', HOME: 'set_point'}[action]
    assert dog.warning().startswith(
        f"ground_lost is '{action}', but /test does not subscribe to {topic}: run computed_torque"
    )
    dog.update(10.0, 0.0)
    assert dog.problem == (
        f'the ground is silent: the motion continues, because /test does not subscribe to {topic}'
    )
