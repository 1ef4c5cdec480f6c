import threading
import time
from collections.abc import Callable, Iterator

import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from std_msgs.msg import String
from std_srvs.srv import Trigger

from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import Topic
from aerarm_ros.ros.executors import LeanExecutor

QOS = QoSProfile(depth=5)


@pytest.fixture
def pauses() -> list[int]:
    """Return a list with an entry for each piece of work that was announced."""
    return []


@pytest.fixture
def executor(ros_node: Node, pauses: list[int]) -> Iterator[LeanExecutor]:
    executor = LeanExecutor(ros_node, lambda: pauses.append(1))
    yield executor
    executor.shutdown()


def spin_until(executor: LeanExecutor, condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        executor.spin_once(timeout_sec=0.05)


def test_every_kind_of_callback_runs_and_is_announced(
    ros_node: Node, executor: LeanExecutor, pauses: list[int]
) -> None:
    heard, ticks, woken = [], [], []
    ros_node.create_subscription(String, 'text', heard.append, QOS)
    with_info = []
    ros_node.create_subscription(String, 'text', lambda m, info: with_info.append(info), QOS)
    publisher = ros_node.create_publisher(String, 'text', QOS)
    ros_node.create_timer(0.01, lambda: ticks.append(1))
    guard = ros_node.create_guard_condition(lambda: woken.append(1))
    ros_node.create_service(Trigger, 'ask', _yes)
    client = ros_node.create_client(Trigger, 'ask')
    guard.trigger()
    spin_until(executor, lambda: len(ticks) > 2 and bool(woken))
    spin_until(executor, client.service_is_ready)
    spin_until(executor, lambda: publisher.get_subscription_count() == 2)
    publisher.publish(String(data='hello'))
    answer = client.call_async(Trigger.Request())
    spin_until(executor, lambda: answer.done() and bool(heard) and bool(with_info))
    assert answer.result().message == 'yes'
    assert heard[0].data == 'hello'
    assert with_info[0]['publication_sequence_number'] == 1
    # Three times at least for the timer, and once for each of guard, service, client and two
    # subscriptions.
    assert len(pauses) >= 8


def test_a_task_continues_when_a_callback_completes_its_future(
    ros_node: Node, executor: LeanExecutor
) -> None:
    # As an action server's: begun by one callback, ended by another.
    waited: Future = Future()
    said = []

    async def work(word: str) -> str:
        said.append(word)
        said.append(await waited)
        return 'done'

    tasks = []
    begin = ros_node.create_guard_condition(
        lambda: tasks.append(executor.create_task(work, 'begun'))
    )
    end = ros_node.create_guard_condition(lambda: waited.set_result('brought'))
    begin.trigger()
    spin_until(executor, lambda: said == ['begun'])
    assert not tasks[0].done()
    end.trigger()
    spin_until(executor, lambda: tasks[0].done())
    assert (said, tasks[0].result()) == (['begun', 'brought'], 'done')


def test_entities_may_come_and_go_while_another_thread_spins(
    ros_node: Node, executor: LeanExecutor
) -> None:
    ended = threading.Event()

    def spin() -> None:
        while not ended.is_set():
            executor.spin_once(timeout_sec=5.0)

    thread = threading.Thread(target=spin)
    thread.start()
    try:
        for index in range(30):
            ticks = threading.Event()
            timer = ros_node.create_timer(1e-3, ticks.set)
            service = ros_node.create_service(Trigger, f'ask{index}', _yes)
            assert ticks.wait(60.0)
            ros_node.destroy_timer(timer)
            ros_node.destroy_service(service)
    finally:
        ended.set()
        executor.wake()
        thread.join(60.0)
    assert not thread.is_alive()


def test_a_wait_ends_when_it_is_woken(ros_node: Node, executor: LeanExecutor) -> None:
    executor.spin_once(timeout_sec=0.0)
    executor.wake()
    executor.spin_once(timeout_sec=3600.0)


def test_messages_of_a_raw_reader_stay_with_it(ros_node: Node, executor: LeanExecutor) -> None:
    topic = Topic('raw', String, QOS)
    reader = RawReader(ros_node, topic)
    publisher = ros_node.create_publisher(String, 'raw', QOS)
    spin_until(executor, lambda: reader.publishers() == 1)
    publisher.publish(String(data='mine'))
    assert reader.wait(60.0)
    executor.spin_once(timeout_sec=0.0)
    assert reader.take() is not None
    reader.destroy()


def test_events_of_publishers_are_served(ros_node: Node, executor: LeanExecutor, capfd) -> None:
    ros_node.create_publisher(
        String, 'weak', QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    ros_node.create_subscription(String, 'weak', _ignore, QOS)
    said = []

    def warned() -> bool:
        said.append(capfd.readouterr().err)
        return 'incompatible' in ''.join(said)

    spin_until(executor, warned)


def test_a_defect_in_a_callback_reaches_the_owner_and_stops_no_other_callback(
    ros_node: Node, executor: LeanExecutor
) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    woken: list[int] = []
    guards = [ros_node.create_guard_condition(call) for call in (fail, lambda: woken.append(1))]
    for guard in guards:
        guard.trigger()
    with pytest.raises(ZeroDivisionError):
        spin_until(executor, lambda: bool(woken))
    # A guard condition tells of itself only once.
    executor.spin_once(timeout_sec=0.0)
    assert woken == [1]


def test_a_destroyed_entity_does_not_run(ros_node: Node, executor: LeanExecutor) -> None:
    ran: list[str] = []

    def destroy_second() -> None:
        ran.append('first')
        ros_node.destroy_guard_condition(second)

    first = ros_node.create_guard_condition(destroy_second)
    second = ros_node.create_guard_condition(lambda: ran.append('second'))
    first.trigger()
    second.trigger()
    spin_until(executor, lambda: bool(ran))
    executor.spin_once(timeout_sec=0.0)
    assert ran == ['first']


def _yes(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
    response.success, response.message = True, 'yes'
    return response


def _ignore(_: String) -> None:
    pass
