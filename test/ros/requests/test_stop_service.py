"""A stop of all bridges, known in advance or not, some of them just discovered."""

import threading
import time
from collections.abc import Callable

from answering_bridges import LIMIT, AnsweringBridges, until_offered
from rclpy.node import Node
from std_srvs.srv import Trigger

from aerarm_ros.hardware.bridge_modes import ACTIONS
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.requests.bridge_service import BridgeFinder, StopRequest, StopService

NO_RESPONSE = 'the bridge did not respond within 1 s: check arm_mode'


def test_a_bridge_that_is_discovered_meanwhile_is_stopped_too(ros_node: Node) -> None:
    stop, bridges = StopService(ros_node, 'e_stop', ['first', 'second'], LIMIT), AnsweringBridges()

    def appear() -> None:
        bridges.add('second', ['e_stop'])
        until_offered(ros_node, 'second/e_stop')

    bridges.add('first', ['e_stop'], appear)
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        assert stop.call() == (True, '/first: done; /second: done')
    assert bridges.asked == ['first', 'second']


def test_a_missing_bridge_is_reported(ros_node: Node) -> None:
    stopped, text = StopService(ros_node, 'e_stop', ['first'], 0.1).call()
    assert not stopped
    assert text.startswith(
        'no bridge offers the service e_stop: check that a bridge runs in this ROS domain'
    )


def test_a_stop_is_for_the_own_namespace(ros_node: Node) -> None:
    bridges = AnsweringBridges()
    for name in ('renamed', '/left/hardware_bridge'):
        bridges.add(name, ACTIONS)
    bridges.add('other_machine', ['e_stop'])
    with BackgroundExecutor(ros_node), BackgroundExecutor(bridges.node):
        stopped, text = StopService(ros_node, 'e_stop', ['hardware_bridge'], LIMIT).call()
        assert (stopped, text) == (True, '/renamed: done')
        assert StopService(ros_node, 'disable', [], LIMIT).call() == (True, '/renamed: done')
    assert bridges.asked == ['renamed', 'renamed']


def test_answers_are_sorted_by_bridge_name(ros_node: Node) -> None:
    bridges, late = AnsweringBridges(), AnsweringBridges()
    bridges.add('second', ACTIONS)
    late.add('first', ACTIONS, lambda: time.sleep(0.2))
    executors = [BackgroundExecutor(node) for node in (ros_node, bridges.node, late.node)]
    with executors[0], executors[1], executors[2]:
        told = StopService(ros_node, 'e_stop', [], LIMIT).call()
    assert told == (True, '/first: done; /second: done')


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
        assert soon.answers['/silent'] == (False, NO_RESPONSE)
        may_end.set()
        # It was asked again, as its answer might have been lost.
        poll_until(lambda: silent.asked.count('silent') > 2)
        poll_until(request.poll)
    assert request.answers == {'/sound': (True, 'done'), '/silent': (True, 'done')}


def poll_until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 2.0 * LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_it_ends_although_services_come_and_go_all_the_time(ros_node: Node) -> None:
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
