"""A person's emergency stop, pressed while bridges are only just being found."""

from collections.abc import Callable

import pytest
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.executors.background_executor import BackgroundExecutor
from aerarm_ros.ros.requests.emergency_stop import EmergencyStop

LIMIT = 20.0  # [s]


class Bridges:
    """Answers e_stop of any number of bridges, all on one node."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('bridges')
        self.stopped: list[str] = []

    def add(self, name: str, before_answer: Callable[[], object] = lambda: None) -> None:
        def stop(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.stopped.append(name)
            before_answer()
            response.success, response.message = True, 'damped'
            return response

        self.node.create_service(Trigger, f'{name}/e_stop', stop)


@pytest.fixture
def bridges(ros_node: Node) -> Bridges:
    return Bridges()


def test_a_bridge_that_is_discovered_meanwhile_is_stopped_too(
    bridges: Bridges, ros_node: Node
) -> None:
    stop = EmergencyStop(ros_node, ['first', 'second'], LIMIT)

    def appear() -> None:
        bridges.add('second')
        assert stop._clients['second'].wait_for_service(LIMIT)

    bridges.add('first', appear)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert stop.press() == (True, 'first: damped; second: damped')
    assert bridges.stopped == ['first', 'second']


def test_without_a_bridge_it_says_what_it_looked_for(ros_node: Node) -> None:
    stop = EmergencyStop(ros_node, ['first', 'second'], 0.1)
    stopped, text = stop.press()
    assert not stopped
    assert text.startswith('no service first/e_stop or second/e_stop: is the bridge running')
