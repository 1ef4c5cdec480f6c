"""A request that cannot be sent counts as an answer, so clients continue with other bridges."""

import time

import pytest
from answering_bridges import LIMIT, AnsweringBridges
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.requests import bridge_service
from aerarm_ros.ros.requests.bridge_service import ServiceCall

NOT_SENT = 'the request to the bridge could not be sent: '


def test_a_request_that_cannot_be_sent_is_refused(ros_node: Node) -> None:
    client = ros_node.create_client(Trigger, 'bridge/e_stop')
    ros_node.destroy_client(client)
    call = ServiceCall(client, LIMIT)
    answer = call.poll()
    assert answer is not None
    assert not answer.accepted
    assert answer.message.startswith(NOT_SENT)
    assert not call.is_answered


def test_repeated_requests_are_sent_until_they_succeed(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bridge_service, 'ASK_AGAIN', 0.0)
    bridges = AnsweringBridges()
    bridges.add('bridge', ['e_stop'])
    client = ros_node.create_client(Trigger, 'bridge/e_stop')
    assert client.wait_for_service(LIMIT)
    with monkeypatch.context() as broken:
        broken.setattr(client, 'call_async', cannot_send)
        call = ServiceCall(client, LIMIT, repeats=True)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert answer_of(call) == (True, 'done')


def test_a_request_that_cannot_be_sent_is_reported_at_the_end(ros_node: Node) -> None:
    client = ros_node.create_client(Trigger, 'bridge/e_stop')
    ros_node.destroy_client(client)
    answer = answer_of(ServiceCall(client, 0.1, repeats=True))
    assert (answer.accepted, answer.message.startswith(NOT_SENT)) == (False, True)


def test_an_unanswered_request_returns_no_response(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = ros_node.create_client(Trigger, 'bridge/e_stop')
    send, tries = client.call_async, [cannot_send]
    monkeypatch.setattr(bridge_service, 'ASK_AGAIN', 0.0)
    monkeypatch.setattr(client, 'call_async', lambda asked: (tries.pop() if tries else send)(asked))
    answer = answer_of(ServiceCall(client, 1.0, repeats=True))
    assert tries == []
    assert answer == (False, 'the bridge did not respond within 1 s: check arm_mode')


def answer_of(call: ServiceCall) -> Answer:
    end = time.monotonic() + LIMIT
    while (answer := call.poll()) is None and time.monotonic() < end:
        time.sleep(0.01)
    assert answer is not None
    return answer


def cannot_send(_: Trigger.Request) -> None:
    raise InvalidHandle('no client')
