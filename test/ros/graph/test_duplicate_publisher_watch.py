import time
from collections.abc import Callable

import pytest
import rclpy
from quick_spinning import spin_once
from rclpy.node import Node

from aerarm_msgs_py.topics import JOINT_STATES
from aerarm_ros.ros.graph import DuplicatePublisherWatch


def publish(name: str) -> Node:
    node = rclpy.create_node(name)
    node.create_publisher(JOINT_STATES.type, JOINT_STATES.name, JOINT_STATES.qos)
    return node


def test_each_change_of_duplicate_publishers_causes_one_warning(
    ros_node: Node, capfd: pytest.CaptureFixture[str]
) -> None:
    ros_node.create_publisher(JOINT_STATES.type, JOINT_STATES.name, JOINT_STATES.qos)
    rivals = DuplicatePublisherWatch(ros_node, JOINT_STATES)

    def wait_for(condition: Callable[[], bool]) -> None:
        end = time.monotonic() + 60.0
        while not condition():
            assert time.monotonic() < end, rivals.problem
            for _ in range(1000):
                rivals.poll()
            spin_once(ros_node, 0.01)

    one = publish('one')
    wait_for(lambda: '2 publishers, /one and /test: stop all but one' in rivals.problem)
    two = publish('two')
    wait_for(lambda: '3 publishers, /one and /test and /two: stop' in rivals.problem)
    two.destroy_node()
    one.destroy_node()
    wait_for(lambda: rivals.problem == '')
    log = capfd.readouterr().err
    assert log.count('/joint_states has 2 publishers, /one and /test') >= 1
    assert log.count('/joint_states has 3 publishers') == 1
    assert 'WARN' in log
