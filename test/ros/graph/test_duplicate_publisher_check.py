import time

import rclpy
from rclpy.node import Node

from aerarm_msgs_py.topics import JOINT_STATES
from aerarm_ros.ros.graph import DuplicatePublisherCheck


def publish(name: str) -> Node:
    node = rclpy.create_node(name, namespace='/left')
    node.create_publisher(JOINT_STATES.type, 'joint_states', JOINT_STATES.qos)
    return node


def wait_for(condition) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_names_the_second_publisher_once_and_is_content_when_it_goes(ros_node: Node) -> None:
    looking = rclpy.create_node('looking', namespace='/left')
    sources = DuplicatePublisherCheck(looking, JOINT_STATES)
    assert sources.problem() == ''
    one = publish('one')
    wait_for(lambda: looking.count_publishers('joint_states') == 1)
    assert sources.problem() == ''
    two = publish('two')
    wait_for(lambda: '/left/one and /left/two: stop all but one' in sources.problem())
    assert sources.problem().startswith('/left/joint_states has 2 publishers')
    assert sources.news() == sources.problem()
    assert sources.news() == ''
    two.destroy_node()
    wait_for(lambda: sources.problem() == '')
    one.destroy_node()
    looking.destroy_node()
