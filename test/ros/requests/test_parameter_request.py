"""Setting a parameter of a node that is just being discovered."""

import pytest
import rclpy
from answering_bridges import LIMIT
from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future

from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.requests.parameter_request import ParameterRequest


@pytest.mark.parametrize('request_type', ['describe_parameters', 'set_parameters'])
def test_unanswered_requests_are_repeated(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch, request_type: str
) -> None:
    ask = getattr(AsyncParameterClient, request_type)
    asked = []

    def lost_at_first(client: AsyncParameterClient, *arguments: object) -> Future:
        asked.append(arguments)
        return Future() if len(asked) == 1 else ask(client, *arguments)

    monkeypatch.setattr(AsyncParameterClient, request_type, lost_at_first)
    other = rclpy.create_node('other')
    other.declare_parameter('gain', 1.0)
    with BackgroundExecutor(other):
        assert ParameterRequest(ros_node, 'other', LIMIT).set('gain', '2') == 2.0
    assert other.get_parameter('gain').value == 2.0
    assert len(asked) > 1
    other.destroy_node()
