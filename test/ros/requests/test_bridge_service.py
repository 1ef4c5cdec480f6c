"""A service of the only running bridge."""

from answering_bridges import LIMIT, AnsweringBridges, until_offered
from rclpy.node import Node

from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.requests.bridge_service import BridgeService


def test_without_a_bridge_the_error_names_the_searched_services(ros_node: Node) -> None:
    hold = BridgeService(ros_node, 'hold', ['first', 'second'], 0.1)
    held, text = hold.call()
    assert not held
    assert text.startswith(
        'no bridge offers the service first/hold or second/hold: check that the bridge runs'
    )


def test_requests_other_than_stops_go_to_one_bridge_only(ros_node: Node) -> None:
    hold, bridges = BridgeService(ros_node, 'hold', ['first', 'second'], LIMIT), AnsweringBridges()
    bridges.add('first', ['hold'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert hold.call() == (True, 'first: done')
        bridges.add('second', ['hold'])
        assert hold._clients['second'].wait_for_service(LIMIT)
        done, text = hold.call()
    assert (done, 'found the bridges first and second' in text) == (False, True)
    assert bridges.asked == ['first']


def test_two_bridges_with_one_name_receive_no_request(ros_node: Node) -> None:
    hold = BridgeService(ros_node, 'hold', ['first'], LIMIT)
    bridges, twins = AnsweringBridges(), AnsweringBridges()
    for one in (bridges, twins):
        one.add('first', ['hold'])
    until_offered(ros_node, 'first/hold', 2)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        done, text = hold.call()
    assert (done, 'found 2 nodes named /first: stop all but one' in text) == (False, True)
    assert bridges.asked == twins.asked == []
