from functools import partial

import pytest
from quick_spinning import spin_until
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.ros.bridge.bridge_services import (
    Action,
    BridgeServices,
    CycleRequests,
    says_not_active,
)


def late(action: Action, is_stop: bool) -> Answer:
    raise TimeoutError


def test_a_cycle_that_does_not_answer_is_said_with_where_to_look(ros_node: Node) -> None:
    BridgeServices(ros_node, late, {'disable': BridgeCycle.disable})
    client = ros_node.create_client(Trigger, '~/disable')
    assert client.wait_for_service(60.0)
    answer = client.call_async(Trigger.Request())
    assert spin_until(ros_node, answer.done, 60.0)
    assert not answer.result().success
    expected = 'the cycle did not respond: check the console of the bridge, or view'
    assert answer.result().message == expected


def test_an_ending_bridge_answers_without_a_warning(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged: list[tuple[str, str]] = []
    for level in ('info', 'warning'):
        log = partial(lambda level, text: logged.append((level, text)), level)
        monkeypatch.setattr(ros_node.get_logger(), level, log)
    requests = CycleRequests()
    requests.open()
    requests.close()
    BridgeServices(ros_node, requests.ask, {'hold': BridgeCycle.hold})
    client = ros_node.create_client(Trigger, '~/hold')
    assert client.wait_for_service(60.0)
    answer = client.call_async(Trigger.Request())
    assert spin_until(ros_node, answer.done, 60.0)
    assert not answer.result().success
    assert says_not_active(answer.result().message)
    assert logged == [('info', f'hold: {answer.result().message}')]
