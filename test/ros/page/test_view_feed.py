"""The page's text about the received states."""

import time

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.ros.page.view_plots import ROWS, ViewFeed

NAMES = ['joint1', 'joint2']


def test_an_unhomed_arm_is_distinguished_from_a_silent_one(ros_node: Node) -> None:
    topic = topics.JOINT_STATES
    publisher = ros_node.create_publisher(topic.type, topic.name, topic.qos)
    feed = ViewFeed(ros_node, NAMES, 1.0, 20.0, has_base=False)

    def described(position: list[float], word: str) -> str:
        deadline = time.monotonic() + 20.0
        while word not in (text := feed.describe(time.monotonic())):
            assert time.monotonic() < deadline, text
            zeros = [0.0, 0.0]
            publisher.publish(
                JointState(name=NAMES, position=position, velocity=zeros, effort=zeros)
            )
            time.sleep(0.02)
            feed.update(time.monotonic())
        return text

    assert 'no joint_states in this ROS domain' in feed.describe(0.0)
    assert described([0.1, float('nan')], 'unknown').startswith('the angle of joint2 is unknown')
    assert feed.posture is None
    described([0.1, 0.2], 'Hz')
    assert feed.posture == pytest.approx([0.1, 0.2])
    feed.destroy()


def test_the_extremes_of_all_windows_since_the_last_picture_are_kept(ros_node: Node) -> None:
    topic = topics.JOINT_STATES
    names = ('', '/minimum', '/maximum')
    publishers = [
        ros_node.create_publisher(topic.type, topic.name + suffix, topic.offered)
        for suffix in names
    ]
    feed = ViewFeed(ros_node, NAMES, 10.0, 20.0, has_base=False)
    first = ROWS.index('q_min')
    deadline = time.monotonic() + 20.0
    values = np.zeros((0, len(ROWS), 2))
    # Two windows come between two pictures, the second without the peak of the first.
    while not (np.isfinite(values[:, first]).any() and values[:, ROWS.index('dq_max')].max() > 5.0):
        assert time.monotonic() < deadline, values
        for peak in (6.0, 0.5):
            for publisher, sign in zip(publishers, (0.0, -1.0, 1.0), strict=True):
                publisher.publish(
                    JointState(
                        name=NAMES[::-1],  # by name, not by place
                        position=[0.2, 0.1],
                        velocity=[sign * peak, 0.0],
                        effort=[0.0, 0.0],
                    )
                )
        time.sleep(0.05)
        feed.update(time.monotonic())
        _, values = feed.joints.window(time.monotonic())
    newest = values[-1]
    assert newest[ROWS.index('dq_max')] == pytest.approx([0.0, 6.0])
    assert newest[ROWS.index('dq_min')] == pytest.approx([0.0, -6.0])
    assert newest[ROWS.index('q_max')] == pytest.approx([0.1, 0.2])
    assert np.isnan(newest[ROWS.index('current_max')]).all()
    # Without new windows nothing is kept of the old ones.
    publishers[0].publish(
        JointState(name=NAMES, position=[0.1, 0.2], velocity=[0.0, 0.0], effort=[0.0, 0.0])
    )
    deadline = time.monotonic() + 20.0
    while not feed.update(time.monotonic()):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert np.isnan(feed.joints.window(time.monotonic())[1][-1, first:]).all()
    feed.destroy()
