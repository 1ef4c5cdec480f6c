"""Publishers that may command a running bridge, and subscribers of its topics."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
from bridge_client import BridgeClient, StartBridge, velocity_command
from quick_spinning import spin_until
from rclpy.node import Node
from rclpy.publisher import Publisher

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import JOINT_COMMAND
from aerarm_ros.ros.bridge.hardware_bridge import BridgeStreams
from aerarm_ros.ros.process.node_process import NodeProcess, ros_environment

FIRST = [0.2, 0.0, 0.0, 0.0]
SECOND = [-0.4, 0.0, 0.0, 0.0]


@pytest.fixture
def intruder(ros_node: Node) -> Iterator[Publisher]:
    node = rclpy.create_node('intruder')
    yield node.create_publisher(JOINT_COMMAND.type, JOINT_COMMAND.name, JOINT_COMMAND.qos)
    node.destroy_node()


def count(client: BridgeClient, reason: str) -> int:
    return int(client.diagnostics['arm'].get(f'rejected {reason}', 0))


@pytest.mark.pace('keep_up')
def test_two_bridges_warn_of_each_other(
    client: BridgeClient, bridge: NodeProcess, tmp_path: Path
) -> None:
    client.wait_for_mode('idle')
    assert 'publishers' not in bridge.tail()
    text = '/joint_states has 2 publishers, /fake_hardware and /other: stop all but one'
    clocks = '/clock has 2 publishers, /fake_hardware and /other, each with a different time'
    rename = ('--ros-args', '-r', '__node:=other')
    keep_up = {'pace': 'keep_up'}
    with NodeProcess('fake_hardware', rename, keep_up, log=tmp_path / 'other') as other:
        client.wait_for(lambda: text in bridge.tail() and text in other.tail())
        client.wait_for(lambda: clocks in bridge.tail() and clocks in other.tail())
        client.wait_for(lambda: text in client.messages['arm'])
    # Several looks later, the second one is gone.
    client.wait_for(lambda: client.messages['arm'] == 'idle')
    assert bridge.tail(50).count('joint_states has') == 1


def test_a_second_publisher_is_identified_rejected_and_named(
    client: BridgeClient, bridge: NodeProcess, intruder: Publisher
) -> None:
    client.make_ready()
    client.answer = lambda state: velocity_command(state, FIRST)
    client.wait_for_mode('running')

    def both(state):
        # Only the newest command counts, so each comes last in turn.
        if len(client.states) % 2:
            intruder.publish(velocity_command(state, SECOND))
            return velocity_command(state, FIRST)
        client.commands.publish(velocity_command(state, FIRST))
        intruder.publish(velocity_command(state, SECOND))
        return None

    client.answer = both
    client.wait_for(lambda: count(client, 'source') > 100)
    assert 'joint_command has 2 publishers (/intruder, /test)' in client.messages['arm']
    assert client.diagnostics['arm']['publishers of joint_command'] == '/intruder, /test'
    said = 'a command was rejected: joint_command has 2 publishers (/intruder, /test)'
    client.wait_for(lambda: said in bridge.tail(50))
    # The first one is followed on.
    client.wait_for(lambda: client.states[-1].velocity[0] > 0.1)
    assert client.modes[-1] == 'running'
    # It ends: after its claim has run out, the other one has the arm.
    client.answer = None
    client.wait_for_mode('damping')

    def second(state):
        intruder.publish(velocity_command(state, SECOND))

    client.answer = second
    client.wait_for(lambda: client.states[-1].velocity[0] < -0.3)


def test_only_allowed_publishers_command(
    start_bridge: StartBridge, ros_node: Node, intruder: Publisher
) -> None:
    start_bridge(allowed_publishers=['test'])
    client = BridgeClient(ros_node)
    client.make_ready()

    def as_intruder(state):
        intruder.publish(velocity_command(state, SECOND))

    client.answer = as_intruder
    client.wait_for(lambda: count(client, 'not_allowed') > 100)
    assert (
        '/intruder publishes joint_command but is not in allowed_publishers'
    ) in client.messages['arm']
    assert client.modes[-1] == 'ready'

    client.answer = lambda state: velocity_command(state, FIRST)
    client.wait_for_mode('running')


SUBSCRIBER = """
import rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node('subscriber')
node.create_subscription(JointState, 'joint_states', lambda message: None, 10)
rclpy.spin(node)
"""


def test_a_subscriber_that_stands_still_holds_no_cycle_up(
    ros_node: Node, ros_domain: dict[str, str]
) -> None:
    streams = BridgeStreams(ros_node, ['joint1', 'joint2', 'joint3', 'joint4'])
    published = topics.JOINT_STATES.name
    with subprocess.Popen([sys.executable, '-c', SUBSCRIBER], env=ros_environment()) as process:
        try:
            assert spin_until(ros_node, lambda: ros_node.count_subscribers(published), 60.0)
            time.sleep(0.3)  # they know each other
            process.send_signal(signal.SIGSTOP)
            begin, values = time.monotonic(), np.zeros(4)
            for index in range(1000):
                streams.publish_joints(index, (values, values, values))
            # To wait for it takes Fast DDS 0.1 s a message.
            assert time.monotonic() - begin < 20.0
        finally:
            process.kill()
    streams.destroy()
