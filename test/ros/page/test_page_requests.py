"""Actions of the page's buttons, without a page."""

import time

import pytest
from answering_bridges import LIMIT, AnsweringBridges, quick_search, until_offered
from rclpy.node import Node

from aerarm_ros.hardware.bridge_modes import ACTIONS
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.page.view_controls import PageRequests

__all__ = ['quick_search']


@pytest.mark.usefixtures('quick_search')
def test_its_stops_reach_unnamed_bridges_that_it_found_before(ros_node: Node) -> None:
    bridges, page = AnsweringBridges(), PageRequests(ros_node, ['hardware_bridge'])
    bridges.add('my_arm', ACTIONS)
    for action in ACTIONS:
        until_offered(ros_node, f'my_arm/{action}')
    page.look_for_bridges()
    end = time.monotonic() + LIMIT
    while not ros_node.count_clients('my_arm/e_stop'):
        assert time.monotonic() < end
        time.sleep(0.01)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert page.ask('e_stop') == page.ask('disable') == (True, '/my_arm: done')
        done, text = page.ask('hold')
    assert (done, 'offers the service hardware_bridge/hold' in text) == (False, True)
    assert bridges.asked == ['my_arm', 'my_arm']
