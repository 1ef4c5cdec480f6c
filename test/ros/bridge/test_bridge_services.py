from functools import partial

import pytest
import rclpy
from quick_spinning import spin_until
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import NOT_ACTIVE, Action, Answer
from aerarm_ros.ros.bridge.bridge_services import BridgeServices, CycleRequests


def late(action: Action, is_stop: bool) -> Answer:
    raise TimeoutError


def test_a_cycle_that_does_not_respond_is_reported_with_a_remedy(ros_node: Node) -> None:
    BridgeServices(ros_node, late, {'disable': BridgeCycle.disable})
    client = ros_node.create_client(Trigger, '~/disable')
    assert client.wait_for_service(60.0)
    answer = client.call_async(Trigger.Request())
    assert spin_until(ros_node, answer.done, 60.0)
    assert not answer.result().success
    expected = "the bridge's cycle did not respond within 1 s: check the log of the bridge"
    assert answer.result().message == expected


def test_only_stops_are_served_while_two_nodes_have_the_same_name(ros_node: Node) -> None:
    def done(action: Action, is_stop: bool) -> Answer:
        return Answer(True, 'done')

    actions = {'enable': BridgeCycle.enable, 'e_stop': lambda cycle: cycle.e_stop('')}
    BridgeServices(ros_node, done, actions)
    twin = rclpy.create_node(ros_node.get_name())
    try:
        same = (ros_node.get_name(), ros_node.get_namespace())
        listed = ros_node.get_node_names_and_namespaces
        assert spin_until(ros_node, lambda: listed().count(same) == 2, 60.0)
        answers = {}
        for name in actions:
            client = ros_node.create_client(Trigger, f'~/{name}')
            assert client.wait_for_service(60.0)
            answer = client.call_async(Trigger.Request())
            assert spin_until(ros_node, answer.done, 60.0)
            answers[name] = answer.result()
    finally:
        twin.destroy_node()
    assert not answers['enable'].success
    assert 'two nodes have the name' in answers['enable'].message
    assert answers['e_stop'].success


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
    assert answer.result().message.endswith(NOT_ACTIVE)
    assert logged == [('info', f'hold: {answer.result().message}')]
