import threading
from functools import partial

import pytest
import rclpy
from quick_spinning import spin_until
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import NOT_ACTIVE, Action, Answer
from aerarm_ros.ros.bridge import bridge_services
from aerarm_ros.ros.bridge.bridge_services import BridgeServices, CycleRequests


@pytest.fixture
def requests() -> CycleRequests:
    requests = CycleRequests()
    requests.open()
    return requests


def ask_beside(requests: CycleRequests, action) -> list:
    """Ask in another thread while this one serves; return what came of it."""
    outcome = []

    def ask():
        try:
            outcome.append(requests.ask(action))
        except ValueError as error:
            outcome.append(error)

    thread = threading.Thread(target=ask)
    thread.start()
    while thread.is_alive():
        requests.serve('the cycle')
        thread.join(1e-3)
    return outcome


def test_an_action_gets_the_cycle_and_gives_its_answer_or_exception(requests):
    seen = []

    def action(cycle):
        seen.append((cycle, threading.current_thread()))
        return Answer(True, 'done')

    assert ask_beside(requests, action) == [Answer(True, 'done')]
    assert seen == [('the cycle', threading.current_thread())]

    def fail(cycle):
        raise ValueError('no such fault')

    (error,) = ask_beside(requests, fail)
    assert str(error) == 'no such fault'


def test_posted_actions_run_in_order_without_waiting_callers(requests):
    done = []
    for number in range(3):
        requests.post(lambda cycle, number=number: done.append(number))
    assert done == []
    requests.serve('the cycle')
    assert done == [0, 1, 2]


def test_without_a_cycle_nothing_is_taken(requests):
    requests.close()
    assert requests.wait_closed(0.0)
    with pytest.raises(RuntimeError, match='activate it first'):
        requests.ask(lambda cycle: Answer(True, ''))
    requests.post(lambda cycle: pytest.fail('served'))
    requests.open()
    requests.serve('the cycle')


@pytest.mark.parametrize('insist', [False, True])
def test_late_actions_run_only_if_they_stop_the_arm(requests, insist, monkeypatch):
    monkeypatch.setattr(bridge_services, '_ANSWER_TIMEOUT', 0.05)
    done = []
    with pytest.raises(TimeoutError):
        requests.ask(lambda cycle: done.append(cycle), insist)
    requests.serve('the cycle')
    assert done == (['the cycle'] if insist else [])


def call(node: Node, name: str) -> Trigger.Response:
    client = node.create_client(Trigger, f'~/{name}')
    assert client.wait_for_service(60.0)
    answer = client.call_async(Trigger.Request())
    assert spin_until(node, answer.done, 60.0)
    return answer.result()


def test_a_cycle_that_does_not_respond_is_reported_with_a_remedy(ros_node: Node) -> None:
    def late(action: Action, is_stop: bool) -> Answer:
        raise TimeoutError

    BridgeServices(ros_node, late, {'disable': BridgeCycle.disable})
    answer = call(ros_node, 'disable')
    assert not answer.success
    assert 'did not respond within 1 s' in answer.message


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
        answers = {name: call(ros_node, name) for name in actions}
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
    answer = call(ros_node, 'hold')
    assert not answer.success
    assert answer.message.endswith(NOT_ACTIVE)
    assert logged == [('info', f'hold: {answer.message}')]
