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
    discovery_time,
)

__all__ = ['quick_search']
pytestmark = pytest.mark.usefixtures('quick_search')


def poll_until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 2.0 * LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


# The search for bridges


def test_only_a_node_with_all_bridge_services_is_a_bridge(ros_node: Node) -> None:
    others = AnsweringBridges()
    for action in ACTIONS:
        others.node.create_client(Trigger, f'asked_for/{action}')
        others.node.create_service(SetBool, f'switch/{action}', lambda _, answer: answer)
    others.add('bridge', ACTIONS)
    others.add('machine', ['e_stop', 'enable'])
    finder = BridgeFinder(ros_node, 'e_stop', ['asked_for'])
    for name in ('bridge', 'switch'):
        for action in ACTIONS:
            until_offered(ros_node, f'{name}/{action}')
    until_offered(ros_node, 'machine/enable')
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


# Calls of one service


def cannot_send(_: Trigger.Request) -> None:
    raise InvalidHandle('no client')


def answer_of(call: ServiceCall) -> Answer:
    end = time.monotonic() + LIMIT
    while (answer := call.poll()) is None and time.monotonic() < end:
        time.sleep(0.01)
    assert answer is not None
    return answer


def test_only_repeated_requests_are_sent_until_they_succeed(
    ros_node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = ros_node.create_client(Trigger, 'bridge/e_stop')
    send, tries = client.call_async, [cannot_send]
    monkeypatch.setattr(client, 'call_async', lambda asked: (tries.pop() if tries else send)(asked))
    done, text = answer_of(ServiceCall(client, LIMIT))
    assert (done, text) == (False, 'the request to the bridge could not be sent: no client')
    monkeypatch.setattr(bridge_service, 'ASK_AGAIN', 0.0)
    tries.append(cannot_send)
    answer = answer_of(ServiceCall(client, 1.0, repeats=True))
    assert tries == []
    assert answer == (False, 'the bridge did not respond within 1 s: check arm_mode')
    bridges = AnsweringBridges()
    bridges.add('bridge', ['e_stop'])
    assert client.wait_for_service(LIMIT)
    tries.append(cannot_send)
    call = ServiceCall(client, LIMIT, repeats=True)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert answer_of(call) == (True, 'done')


# Requests to the only bridge


def test_requests_other_than_stops_go_to_one_bridge_only(ros_node: Node) -> None:
    hold = BridgeService(ros_node, 'hold', ['first', 'second'], LIMIT)
    held, text = hold.call(0.1)
    assert not held
    assert text.startswith(
        'no bridge offers the service first/hold or second/hold: check that a bridge runs'
    )
    bridges, twins = AnsweringBridges(), AnsweringBridges()
    bridges.add('first', ['hold'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert hold.call() == (True, 'done')
        bridges.add('second', ['hold'])
        assert hold._clients['second'].wait_for_service(LIMIT)
        done, text = hold.call()
        assert (done, 'found the bridges first and second' in text) == (False, True)
        twins.add('first', ['hold'])
        until_offered(ros_node, 'first/hold', 2)
        done, text = BridgeService(ros_node, 'hold', ['first'], LIMIT).call()
    assert (done, 'found 2 nodes named /first: stop all but one' in text) == (False, True)
    assert (bridges.asked, twins.asked) == (['first'], [])
