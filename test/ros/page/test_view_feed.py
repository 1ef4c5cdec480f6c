"""The received states, and the page's text about them."""

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
    now = time.monotonic()
    times, values = feed.window(now)
    assert values.shape == (len(times), len(ROWS), 2)
    assert np.all(np.diff(times) > 0.0)
    np.testing.assert_allclose(values[:, 0], [[0.1, 0.2]] * len(times))
    assert len(feed.window(now + 2.0)[0]) == 0  # older than a second
    feed.destroy()
