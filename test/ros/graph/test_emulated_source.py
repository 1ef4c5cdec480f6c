"""An emulated arm with its own time, detected by its bridge's topics."""

import time
from functools import partial

import rclpy
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock

from aerarm_msgs_py.topics import CLOCK, JOINT_STATES
from aerarm_ros.ros.graph import SilencePatience, is_emulated

STATES = '/left/joint_states'


def publish_states(name: str) -> Node:
    node = rclpy.create_node(name, namespace='/left')
    node.create_publisher(JOINT_STATES.type, JOINT_STATES.name, JOINT_STATES.qos)
    return node


def wait_for(node: Node, states: int, clock: str) -> None:
    """Wait until a node sees so many publishers of joint states, and one of a clock."""
    end = time.monotonic() + 60.0
    while node.count_publishers(STATES) != states or node.count_publishers(clock) != 1:
        assert time.monotonic() < end
        time.sleep(0.01)


def test_only_an_arm_with_a_clock_of_its_own_is_emulated(ros_node: Node) -> None:
    emulated, real = publish_states('emulated'), publish_states('real')
    player = rclpy.create_node('player', namespace='/left')
    player.create_publisher(Clock, CLOCK.name, CLOCK.qos)
    wait_for(ros_node, 2, CLOCK.name)
    assert not is_emulated(ros_node, STATES)  # the clock is that of another node
    emulated.create_publisher(Clock, 'time', CLOCK.qos)
    wait_for(ros_node, 2, '/left/time')
    assert not is_emulated(ros_node, STATES)
    assert SilencePatience(ros_node, STATES).limit(0.2) == 0.2
    real.destroy_node()
    wait_for(ros_node, 1, '/left/time')
    assert is_emulated(ros_node, STATES)
    assert not is_emulated(ros_node, '/joint_states')
    patience = SilencePatience(ros_node, STATES)
    assert (patience.limit(0.2), patience.limit(60.0)) == (10.0, 60.0)
    for node in (emulated, player):
        node.destroy_node()


def test_a_vanished_node_does_not_count(ros_node: Node, monkeypatch) -> None:
    bridge = publish_states('bridge')
    bridge.create_publisher(Clock, CLOCK.name, CLOCK.qos)
    wait_for(ros_node, 1, CLOCK.name)
    seen = ros_node.get_publishers_info_by_topic(STATES)
    bridge.destroy_node()
    end = time.monotonic() + 60.0
    while ('bridge', '/left') in ros_node.get_node_names_and_namespaces():
        assert time.monotonic() < end
        time.sleep(0.01)
    monkeypatch.setattr(ros_node, 'get_publishers_info_by_topic', lambda _: seen)
    assert not is_emulated(ros_node, STATES)


def test_endpoints_of_unknown_nodes_are_distinguished_by_process(
    ros_node: Node, monkeypatch
) -> None:
    bridge = publish_states('bridge')
    bridge.create_publisher(Clock, CLOCK.name, CLOCK.qos)
    wait_for(ros_node, 1, CLOCK.name)
    look = ros_node.get_publishers_info_by_topic

    def without_names(topic: str, gid: int = 0) -> list[TopicEndpointInfo]:
        ends = look(topic)
        for end in ends:
            end.node_name = '_NODE_NAME_UNKNOWN_'
            if topic == CLOCK.name and gid:
                end.endpoint_gid = [gid] * len(end.endpoint_gid)
        return ends

    monkeypatch.setattr(ros_node, 'get_publishers_info_by_topic', without_names)
    assert is_emulated(ros_node, STATES)
    monkeypatch.setattr(ros_node, 'get_publishers_info_by_topic', partial(without_names, gid=7))
    assert not is_emulated(ros_node, STATES)
    bridge.destroy_node()
