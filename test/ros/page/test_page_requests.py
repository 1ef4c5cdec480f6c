"""Actions of the page's buttons, without a page."""

import time

from answering_bridges import LIMIT, AnsweringBridges, until_offered
from rclpy.node import Node

from aerarm_ros.hardware.bridge_modes import ACTIONS
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.page.view_controls import PageRequests


def test_its_emergency_stop_reaches_unnamed_bridges_of_its_namespace(ros_node: Node) -> None:
    bridges = AnsweringBridges()
    for name in ('my_arm', '/left/fake_hardware'):
        bridges.add(name, ACTIONS)
    page = PageRequests(ros_node, ['hardware_bridge', 'fake_hardware'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert page.ask('e_stop') == (True, '/my_arm: done')
        assert page.ask('disable') == (True, '/my_arm: done')
        done, text = page.ask('hold')
    assert (done, 'offers the service hardware_bridge/hold' in text) == (False, True)
    assert bridges.asked == ['my_arm', 'my_arm']


def test_without_a_bridge_in_its_namespace_its_emergency_stop_reaches_all(ros_node: Node) -> None:
    bridges = AnsweringBridges()
    bridges.add('/left/fake_hardware', ACTIONS)
    page = PageRequests(ros_node, ['hardware_bridge', 'fake_hardware'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert page.ask('e_stop') == (True, '/left/fake_hardware: done')


def test_bridges_are_found_before_the_stop_request(ros_node: Node) -> None:
    bridges, page = AnsweringBridges(), PageRequests(ros_node, [])
    bridges.add('my_arm', ACTIONS)
    for action in ACTIONS:
        until_offered(ros_node, f'my_arm/{action}')
    page.look_for_bridges()
    end = time.monotonic() + LIMIT
    while not ros_node.count_clients('my_arm/e_stop'):
        assert time.monotonic() < end
        time.sleep(0.01)
