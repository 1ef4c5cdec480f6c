"""Services of bridges, asked while they are only just being found."""

from collections.abc import Callable

import pytest
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.executors.background_executor import BackgroundExecutor
from aerarm_ros.ros.requests.bridge_service import BridgeService

LIMIT = 20.0  # [s]


class Bridges:
    """Answers one service of any number of bridges, all on one node."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('bridges')
        self.asked: list[str] = []

    def add(
        self,
        name: str,
        before_answer: Callable[[], object] = lambda: None,
        action: str = 'e_stop',
    ) -> None:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.asked.append(name)
            before_answer()
            response.success, response.message = True, 'done'
            return response

        self.node.create_service(Trigger, f'{name}/{action}', answer)


@pytest.fixture
def bridges(ros_node: Node) -> Bridges:
    return Bridges()


def test_a_bridge_that_is_discovered_meanwhile_is_stopped_too(
    bridges: Bridges, ros_node: Node
) -> None:
    stop = BridgeService(ros_node, 'e_stop', ['first', 'second'], LIMIT)

    def appear() -> None:
        bridges.add('second')
        assert stop._clients['second'].wait_for_service(LIMIT)

    bridges.add('first', appear)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert stop.call() == (True, 'first: done; second: done')
    assert bridges.asked == ['first', 'second']


def test_without_a_bridge_it_says_what_it_looked_for(ros_node: Node) -> None:
    stop = BridgeService(ros_node, 'e_stop', ['first', 'second'], 0.1)
    stopped, text = stop.call()
    assert not stopped
    assert text.startswith('no service first/e_stop or second/e_stop: is the bridge running')


def test_what_stops_no_arm_is_asked_of_one_bridge_only(bridges: Bridges, ros_node: Node) -> None:
    hold = BridgeService(ros_node, 'hold', ['first', 'second'], LIMIT)
    bridges.add('first', action='hold')
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert hold.call() == (True, 'first: done')
        bridges.add('second', action='hold')
        assert hold._clients['second'].wait_for_service(LIMIT)
        done, text = hold.call()
    assert (done, 'there are first and second' in text) == (False, True)
    assert bridges.asked == ['first']
