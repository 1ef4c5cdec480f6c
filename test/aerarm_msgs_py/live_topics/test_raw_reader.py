"""Reader and publishers over real DDS, in one process and domain."""

import time
from collections.abc import Callable

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.topics import Topic

DEEP = Topic('words', String, QoSProfile(depth=100))
OTHER = Topic('others', String, QoSProfile(depth=100))


@pytest.fixture
def reader(ros_node: Node):
    reader = RawReader(ros_node, DEEP, OTHER)
    yield reader
    reader.destroy()


@pytest.fixture
def publisher(ros_node: Node, reader: RawReader):
    publisher = ros_node.create_publisher(String, DEEP.name, DEEP.qos)
    wait_until(lambda: publisher.get_subscription_count() == 1 and reader.publishers(0) == 1)
    return publisher


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def take_text(reader: RawReader, index: int = 0) -> str:
    wait_until(lambda: reader.wait(1.0))
    payload, _ = reader.take(index)
    return deserialize_message(payload, String).data


def test_takes_messages_one_by_one_in_order(reader: RawReader, publisher) -> None:
    assert not reader.wait(0.0)
    assert reader.take() is None
    for k in range(5):
        publisher.publish(String(data=f'{k}'))
    assert [take_text(reader) for _ in range(5)] == list('01234')
    assert reader.take(0) is None
    assert reader.take(1) is None
    assert (reader.count(0), reader.count(1)) == (5, 0)


def test_takes_the_newest(reader: RawReader, publisher) -> None:
    for k in range(5):
        publisher.publish(String(data=f'{k}'))
    assert publisher.wait_for_all_acked()
    wait_until(lambda: reader.wait(1.0))
    payload, _ = reader.take_newest()
    assert deserialize_message(payload, String).data == '4'
    assert reader.take_newest() is None
    assert reader.count() == 5


def test_serialized_bytes_come_through_as_they_are(reader: RawReader, publisher) -> None:
    payload = b'\0\1\0\0\3\0\0\0ab\0\0'
    publisher.publish(payload)
    wait_until(lambda: reader.wait(1.0))
    found, info = reader.take()
    assert found == payload
    assert info['publication_sequence_number'] == 1
    assert 0 < info['source_timestamp'] <= info['received_timestamp']


def test_counts_messages_lost_by_a_short_queue(ros_node: Node) -> None:
    newest = Topic('words', String, QoSProfile(depth=1))
    reader = RawReader(ros_node, newest)
    assert reader.lost() is None
    publisher = ros_node.create_publisher(String, newest.name, DEEP.qos)
    wait_until(lambda: publisher.get_subscription_count() == 1 and reader.publishers() == 1)
    for last in ('first', 'second', 'third', 'fourth'):
        publisher.publish(String(data=last))
        if last == 'first':
            assert take_text(reader) == 'first'
    assert publisher.wait_for_all_acked()
    wait_until(lambda: reader.wait(1.0))
    assert deserialize_message(reader.take_newest()[0], String).data == 'fourth'
    assert (reader.count(), reader.lost()) == (2, 2)
    reader.destroy()


def test_an_executor_on_the_node_takes_nothing(reader: RawReader, publisher, ros_node) -> None:
    executor = SingleThreadedExecutor()
    executor.add_node(ros_node)
    publisher.publish(String(data='mine'))
    for _ in range(10):
        executor.spin_once(timeout_sec=0.01)
    assert take_text(reader) == 'mine'
    executor.shutdown()


def test_a_wait_ends_when_the_context_does(ros_domain) -> None:
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('test', context=context)
    reader = RawReader(node, DEEP)
    rclpy.shutdown(context=context)
    assert not reader.wait(0.01)


def test_each_publishers_losses_are_counted(ros_node: Node) -> None:
    short = Topic('words', String, QoSProfile(depth=5))
    reader = RawReader(ros_node, short)
    first, second = (ros_node.create_publisher(String, short.name, DEEP.qos) for _ in range(2))
    wait_until(lambda: reader.publishers() == 2)
    taken: list[tuple[bytes, dict]] = []
    published = 0

    def publish(*rounds: tuple[object, int]) -> None:
        nonlocal published
        for publisher, count in rounds:
            for _ in range(count):
                publisher.publish(String(data='word'))
                published += 1
        assert first.wait_for_all_acked()
        assert second.wait_for_all_acked()
        wait_until(lambda: reader.wait(1.0))
        while (message := reader.take()) is not None:
            taken.append(message)

    publish((first, 1))
    publish((second, 3))
    publish((first, 10), (second, 12))  # more than may wait
    publish((second, 1), (first, 1))
    assert len(taken) == reader.count()
    assert 0 < reader.lost() == published - len(taken)
    payload, info = taken[0]
    assert deserialize_message(payload, String).data == 'word'
    assert info['publication_sequence_number'] == 1
    assert 0 < info['source_timestamp'] <= info['received_timestamp']
    ids = {bytes(x.endpoint_gid) for x in ros_node.get_publishers_info_by_topic(short.name)}
    assert {info['publisher'] for _, info in taken} == ids
    reader.destroy()


def test_a_long_message_is_received_completely(ros_node: Node) -> None:
    reader = RawReader(ros_node, DEEP)
    publisher = ros_node.create_publisher(String, DEEP.name, DEEP.qos)
    wait_until(lambda: publisher.get_subscription_count() == 1)
    for length in (100_000, 3, 1_000_000):
        publisher.publish(String(data='x' * length))
        assert take_text(reader) == 'x' * length
    reader.destroy()
