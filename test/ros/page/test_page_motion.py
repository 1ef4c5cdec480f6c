"""Motions from the page, as the topics that a controller takes."""

import time
from typing import Any

import numpy as np
from quick_spinning import spin_once
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.ros.controllers.trajectory_input import read_trajectory
from aerarm_ros.ros.page.view_controls import PageMotion


def test_a_posture_is_reached_at_no_more_than_the_speed_that_is_set(ros_node: Node) -> None:
    config = load_arm_config()
    motion = PageMotion(ros_node, config)
    start, goal = np.array([0.0, 1.5, 0.0, 0.0]), [0.4, 0.2, -0.3, 0.0]
    sent, text = motion.go(start, goal, 0.5)
    assert (sent, 'start the controller computed_torque' in text) == (False, True)
    heard: list[Any] = []
    topic = topics.JOINT_TRAJECTORY
    ros_node.create_subscription(topic.type, topic.name, heard.append, topic.qos)
    deadline = time.monotonic() + 60.0
    while not (heard and sent):
        assert time.monotonic() < deadline
        sent = motion.go(start, goal, 0.5)[0]
        spin_once(ros_node, 0.1)
    trajectory, begin = read_trajectory(JointLimits.from_config(config), heard[-1], 1.0)
    assert begin is None
    path = trajectory.path(start)
    times = np.linspace(0.0, trajectory.times[-1], 200)
    speed = np.array([np.abs(path.evaluate(t).dq) for t in times]).max(axis=0)
    share = speed / config.column('velocity_max')
    assert share.max() <= 0.501
    np.testing.assert_allclose(path.evaluate(times[-1]).q, goal, atol=1e-9)
    # The whole of the limits leaves room for a controller that wants the arm a little elsewhere.
    assert motion.go(start, goal, 1.0)[0]
    slow = heard[-1].points[0].time_from_start
    while heard[-1].points[0].time_from_start == slow:
        assert time.monotonic() < deadline
        spin_once(ros_node, 0.1)
    trajectory, _ = read_trajectory(JointLimits.from_config(config), heard[-1], 1.0)
    trajectory.path(start + [-0.01, 0.01, 0.01, 0.0])
