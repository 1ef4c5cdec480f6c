"""Readers and publishers over real DDS, in one process and domain."""

import random
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
from aerarm_msgs_py.sequence_gaps import UNNUMBERED, PublisherGaps
from aerarm_msgs_py.topics import Topic

DEEP = Topic('words', String, QoSProfile(depth=100))
OTHER = Topic('others', String, QoSProfile(depth=100))


@pytest.fixture
def reader(ros_node: Node):
    reader = RawReader(ros_node, DEEP, OTHER, identify=True)
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


def take_text(reader: RawReader) -> str:
    wait_until(lambda: reader.wait(1.0))
    payload, _ = reader.take()
    return deserialize_message(payload, String).data


def test_every_message_arrives_once_and_in_order(reader: RawReader, publisher, ros_node) -> None:
    assert not reader.wait(0.0)
    payload = b'\0\1\0\0\3\0\0\0ab\0\0'
    publisher.publish(payload)
    executor = SingleThreadedExecutor()  # takes nothing from the reader
    executor.add_node(ros_node)
    for _ in range(10):
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    wait_until(lambda: reader.wait(1.0))
    found, info = reader.take()
    assert found == payload
    assert info['publication_sequence_number'] == 1
    assert 0 < info['source_timestamp'] <= info['received_timestamp']
    texts = [*'01234', 'x' * 100_000, 'xxx', 'x' * 1_000_000]
    for text in texts:
        publisher.publish(String(data=text))
        assert take_text(reader) == text
    assert reader.take(0) is None
    assert reader.take(1) is None
    assert (reader.count(0), reader.count(1)) == (1 + len(texts), 0)


def test_takes_the_newest(reader: RawReader, publisher) -> None:
    for k in range(5):
        publisher.publish(String(data=f'{k}'))
    assert publisher.wait_for_all_acked()
    wait_until(lambda: reader.wait(1.0))
    payload, _ = reader.take_newest()
    assert deserialize_message(payload, String).data == '4'
    assert reader.take_newest() is None
    assert reader.count() == 5


def test_a_wait_ends_when_the_context_does(ros_domain) -> None:
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('test', context=context)
    reader = RawReader(node, DEEP, identify=True)
    rclpy.shutdown(context=context)
    assert not reader.wait(0.01)


@pytest.mark.parametrize('depth', [1, 5])
def test_messages_that_a_short_queue_lost_are_counted(ros_node: Node, depth: int) -> None:
    short = Topic('words', String, QoSProfile(depth=depth))
    reader = RawReader(ros_node, short, identify=True)
    assert reader.lost() is None
    publishers = [ros_node.create_publisher(String, short.name, DEEP.qos) for _ in range(2)]
    wait_until(lambda: reader.publishers() == 2)
    taken: list[dict] = []
    rounds = [(1, 0), (0, 3), (10, 12), (1, 1)]  # of the two publishers
    for counts in rounds:
        for publisher, count in zip(publishers, counts, strict=True):
            for _ in range(count):
                publisher.publish(String(data='word'))
            assert publisher.wait_for_all_acked()
        wait_until(lambda: reader.wait(1.0))
        while (message := reader.take_newest() if depth == 1 else reader.take()) is not None:
            taken.append(message[1])
    assert len(taken) == reader.count()
    missing = sum(map(sum, rounds)) - len(taken)
    # Only a received message of a publisher shows which messages before it are lost.
    assert 0 < reader.lost() <= missing
    assert depth == 1 or reader.lost() == missing
    ids = {bytes(x.endpoint_gid) for x in ros_node.get_publishers_info_by_topic(short.name)}
    assert {info['publisher'] for info in taken} == ids
    reader.destroy()


@pytest.mark.parametrize('seed', range(20))
def test_every_loss_between_first_and_last_message_of_a_publisher_is_counted(seed: int) -> None:
    rng = random.Random(seed)
    streams = {}
    lost = 0
    for index in range(rng.randint(1, 6)):
        first = rng.choice([1, 7, 1000])
        kept = [k for k in range(first, first + 30) if rng.random() < 0.7]
        lost += kept[-1] - kept[0] + 1 - len(kept)
        streams[bytes([index])] = [*kept[:3], *kept[:3], *kept[3:]]  # repeated messages
    gaps = PublisherGaps()
    for number in UNNUMBERED:
        gaps.add(number, b'\0')
    assert gaps.lost is None
    while any(streams.values()):
        publisher = rng.choice([x for x, kept in streams.items() if kept])
        gaps.add(streams[publisher].pop(0), publisher)
    assert gaps.lost == lost
