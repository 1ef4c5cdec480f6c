"""Services like those of bridges, which answer when a test permits it."""

import time
from collections.abc import Callable, Collection

import pytest
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.ros.requests import bridge_service

LIMIT = 20.0  # [s]
_made: list[Node] = []


@pytest.fixture
def quick_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten the search: nodes of one process share a participant and need no discovery."""
    monkeypatch.setattr(bridge_service, 'discovery_time', lambda: 0.3)
    monkeypatch.setattr(bridge_service, '_PAUSE', 0.2)


def destroy_bridges() -> None:
    """Destroy the nodes of all bridges, which later tests in their domain would see."""
    while _made:
        _made.pop().destroy_node()


class AnsweringBridges:
    """Serve the services of any number of bridges with one node."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('bridges')
        _made.append(self.node)
        self.asked: list[str] = []

    def add(
        self,
        name: str,
        actions: Collection[str],
        before_answer: Callable[[], object] = lambda: None,
    ) -> None:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            self.asked.append(name)
            before_answer()
            response.success, response.message = True, 'done'
            return response

        for action in actions:
            self.node.create_service(Trigger, f'{name}/{action}', answer)


def until_offered(node: Node, service: str, count: int = 1) -> None:
    """Wait until a node sees so many servers of a service."""
    end = time.monotonic() + LIMIT
    while node.count_services(service) != count:
        assert time.monotonic() < end, service
        time.sleep(0.01)
