"""Requests to bridges: stops of all bridges, and requests to the only bridge."""

import threading
import time
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from answering_bridges import LIMIT, AnsweringBridges, quick_search, until_offered
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from aerarm_ros.hardware.bridge_modes import ACTIONS, Answer
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.process.node_process import PROFILES_FILE
from aerarm_ros.ros.requests import bridge_service
from aerarm_ros.ros.requests.bridge_service import (
    BridgeFinder,
    BridgeService,
    ServiceCall,
    StopRequest,
    StopService,
    bridges_among,
    discovery_time,
)

__all__ = ['quick_search']
pytestmark = pytest.mark.usefixtures('quick_search')
NOT_SENT = 'the request to the bridge could not be sent: '


def poll_until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 2.0 * LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


# The search for bridges


def test_a_node_with_all_bridge_services_is_a_bridge() -> None:
    services = [f'/right/arm_of_mine/{action}' for action in (*ACTIONS, 'put_back')]
    services += [f'/hardware_bridge/{action}' for action in ACTIONS]
    services += ['/other_machine/e_stop', '/other_machine/enable']
    assert bridges_among(services) == ['/hardware_bridge', '/right/arm_of_mine']


def test_clients_and_servers_of_another_type_are_no_bridges(ros_node: Node) -> None:
    others = AnsweringBridges()
    for action in ACTIONS:
        others.node.create_client(Trigger, f'asked_for/{action}')
        others.node.create_service(SetBool, f'switch/{action}', lambda _, answer: answer)
    others.add('bridge', ACTIONS)
    finder = BridgeFinder(ros_node, 'e_stop', ['asked_for'])
    for name in ('bridge', 'switch'):
        for action in ACTIONS:
            until_offered(ros_node, f'{name}/{action}')
    assert list(finder.find()) == ['/bridge']


def test_the_search_takes_longer_without_the_packaged_profile_and_on_a_busy_host(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert discovery_time() == 2.0
    now = 0.0
    monkeypatch.setattr(bridge_service, 'time', SimpleNamespace(monotonic=lambda: now))

    def duration(step: float) -> float:
        """Return the time of a search whose steps take so long [s]."""
        nonlocal now
        finder, begin = BridgeFinder(ros_node, 'e_stop', []), now
        while not finder.is_settled():
            now += step
            finder.find()
        return now - begin

    monkeypatch.setattr(bridge_service, 'discovery_time', discovery_time)
    monkeypatch.setattr(bridge_service, '_PAUSE', 1.0)
    assert duration(0.02) == pytest.approx(2.0, abs=0.05)
    assert duration(0.5) > 9.0
    monkeypatch.setenv(PROFILES_FILE, '/another_profile.xml')
    assert duration(0.02) == pytest.approx(4.0, abs=0.05)


# Stops of all bridges


def test_a_bridge_that_is_discovered_meanwhile_is_stopped_too(ros_node: Node) -> None:
    stop, bridges = StopService(ros_node, 'e_stop', ['first', 'second'], LIMIT), AnsweringBridges()

    def appear() -> None:
        bridges.add('second', ['e_stop'])
        until_offered(ros_node, 'second/e_stop')

    bridges.add('first', ['e_stop'], appear)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert stop.call() == (True, '/first: done; /second: done')
    assert bridges.asked == ['first', 'second']


def test_a_stop_is_for_the_own_namespace(ros_node: Node) -> None:
    bridges = AnsweringBridges()
    bridges.add('/left/hardware_bridge', ACTIONS)
    bridges.add('other_machine', ['e_stop'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        # Without a bridge there, only the e-stop reaches other namespaces.
        found = StopService(ros_node, 'disable', ['hardware_bridge'], 0.5).call()
        assert (found[0], 'no bridge offers the service disable' in found[1]) == (False, True)
        stop = StopService(ros_node, 'e_stop', ['hardware_bridge'], LIMIT)
        assert StopService(ros_node, 'e_stop', ['none'], 0.5).call() == (
            True,
            '/left/hardware_bridge: done',
        )
        bridges.add('renamed', ACTIONS)
        for action in ACTIONS:
            until_offered(ros_node, f'renamed/{action}')
        assert stop.call() == (True, '/renamed: done')
        assert StopService(ros_node, 'disable', [], LIMIT).call() == (True, '/renamed: done')
    assert bridges.asked == ['/left/hardware_bridge', 'renamed', 'renamed']


def test_a_bridge_that_never_answers_delays_no_other(ros_node: Node) -> None:
    bridges, silent, may_end = AnsweringBridges(), AnsweringBridges(), threading.Event()
    bridges.add('sound', ACTIONS)
    silent.add('silent', ACTIONS, lambda: may_end.wait(LIMIT))
    finder = BridgeFinder(ros_node, 'e_stop', [])
    request, soon = StopRequest(ros_node, finder, LIMIT), StopRequest(ros_node, finder, 1.0)
    executors = [BackgroundExecutor(node) for node in (ros_node, bridges.node, silent.node)]
    with executors[0], executors[1], executors[2]:
        poll_until(lambda: request.poll() or request.answers)
        assert request.answers == {'/sound': (True, 'done')}
        poll_until(soon.poll)
        silence = 'the bridge did not respond within 1 s: check arm_mode'
        assert soon.answers['/silent'] == (False, silence)
        may_end.set()
        # It was asked again, as its answer might have been lost.
        poll_until(lambda: silent.asked.count('silent') > 2)
        poll_until(request.poll)
    assert request.answers == {'/sound': (True, 'done'), '/silent': (True, 'done')}


def test_it_ends_although_services_come_and_go_all_the_time(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bridge_service, '_LOOKING_MAX', 1.5)
    bridges, over = AnsweringBridges(), threading.Event()
    bridges.add('sound', ACTIONS)

    def come_and_go() -> None:
        while not over.wait(0.1):
            service = bridges.node.create_service(Trigger, 'other/enable', lambda _, answer: answer)
            over.wait(0.1)
            bridges.node.destroy_service(service)

    request = StopRequest(ros_node, BridgeFinder(ros_node, 'e_stop', []), 1.0)
    coming = threading.Thread(target=come_and_go)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        coming.start()
        try:
            poll_until(request.poll)
        finally:
            over.set()
            coming.join()
    assert request.answers == {'/sound': (True, 'done')}


def test_two_bridges_with_one_name_are_not_reported_as_stopped(ros_node: Node) -> None:
    bridges, twins = AnsweringBridges(), AnsweringBridges()
    for one in (bridges, twins):
        one.add('first', ACTIONS)
    until_offered(ros_node, 'first/e_stop', 2)
    executors = [BackgroundExecutor(node) for node in (ros_node, bridges.node, twins.node)]
    with executors[0], executors[1], executors[2]:
        stopped, text = StopService(ros_node, 'e_stop', [], LIMIT).call()
    assert not stopped
    assert text.startswith('/first: found 2 nodes named /first: stop all but one')
    assert 'first' in bridges.asked
    assert 'first' in twins.asked


# Calls of one service


def test_a_request_that_cannot_be_sent_is_refused(ros_node: Node) -> None:
    client = ros_node.create_client(Trigger, 'bridge/e_stop')
    ros_node.destroy_client(client)
    call = ServiceCall(client, LIMIT)
    answer = call.poll()
    assert answer is not None
    assert not answer.accepted
    assert answer.message.startswith(NOT_SENT)


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


# Requests to the only bridge


def test_without_a_bridge_the_error_names_the_searched_services(ros_node: Node) -> None:
    hold = BridgeService(ros_node, 'hold', ['first', 'second'], 0.1)
    held, text = hold.call()
    assert not held
    assert text.startswith(
        'no bridge offers the service first/hold or second/hold: check that a bridge runs'
    )


def test_requests_other_than_stops_go_to_one_bridge_only(ros_node: Node) -> None:
    hold, bridges = BridgeService(ros_node, 'hold', ['first', 'second'], LIMIT), AnsweringBridges()
    bridges.add('first', ['hold'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert hold.call() == (True, 'done')
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
