import threading

import pytest

from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.ros.bridge.bridge_services import CycleRequests


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


def test_an_action_gets_the_cycle_and_gives_its_answer(requests):
    seen = []

    def action(cycle):
        seen.append((cycle, threading.current_thread()))
        return Answer(True, 'done')

    assert ask_beside(requests, action) == [Answer(True, 'done')]
    assert seen == [('the cycle', threading.current_thread())]


def test_an_exception_of_an_action_is_raised_in_the_caller(requests):
    def action(cycle):
        raise ValueError('no such fault')

    (error,) = ask_beside(requests, action)
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


def test_a_cycle_that_does_not_serve_is_noticed(requests):
    with pytest.raises(TimeoutError):
        requests.ask(lambda cycle: Answer(True, ''))


@pytest.mark.parametrize('insist', [False, True])
def test_late_actions_run_only_if_they_stop_the_arm(requests, insist):
    done = []
    with pytest.raises(TimeoutError):
        requests.ask(lambda cycle: done.append(cycle), insist)
    requests.serve('the cycle')
    assert done == (['the cycle'] if insist else [])
