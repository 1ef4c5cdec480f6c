"""Subscriptions of other programs: reliable, with a queue of ten, sometimes slow."""

import signal
import subprocess
import sys
import time

import numpy as np
from bridge_client import BridgeClient, StartBridge
from quick_spinning import spin_until
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

from aerarm_msgs_py import topics
from aerarm_ros.ros.bridge.hardware_bridge import BridgeStreams
from aerarm_ros.ros.process.node_process import ros_environment

SUBSCRIBER = """
import rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node('subscriber')
node.create_subscription(JointState, 'joint_states', lambda message: None, 10)
rclpy.spin(node)
"""


def test_subscriptions_with_default_qos_receive_from_the_bridge(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    # In lockstep a world that stands before somebody listens tells joint_states alone again.
    start_bridge(base_motion_profile='tilted', pace='keep_up')
    client = BridgeClient(ros_node)
    heard: dict[str, object] = {}
    for name, kind in (
        ('joint_states', JointState),
        ('motor_states', JointState),
        ('motor_power', Float64MultiArray),
        ('imu', Imu),
    ):
        ros_node.create_subscription(
            kind, name, lambda message, name=name: heard.setdefault(name, message), 10
        )
    client.wait_for(lambda: len(heard) == 4)


def test_a_subscriber_that_stands_still_holds_no_cycle_up(
    ros_node: Node, ros_domain: dict[str, str]
) -> None:
    streams = BridgeStreams(ros_node, ['joint1', 'joint2', 'joint3', 'joint4'])
    published = topics.JOINT_STATES.name
    with subprocess.Popen([sys.executable, '-c', SUBSCRIBER], env=ros_environment()) as process:
        try:
            assert spin_until(ros_node, lambda: ros_node.count_subscribers(published), 60.0)
            time.sleep(0.5)  # they know each other
            process.send_signal(signal.SIGSTOP)
            begin, values = time.monotonic(), np.zeros(4)
            for index in range(3000):
                streams.publish_joints(index, (values, values, values))
            # To wait for it takes Fast DDS 0.1 s a message.
            assert time.monotonic() - begin < 60.0
        finally:
            process.kill()
    streams.destroy()
