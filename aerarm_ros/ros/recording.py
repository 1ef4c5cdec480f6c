"""Recording of topics: their names, their lost messages, and the bag."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.cdr import ENCAPSULATION_SIZE
from aerarm_msgs_py.live_topics import RawReader
from aerarm_msgs_py.sequence_gaps import UNNUMBERED
from aerarm_msgs_py.topics import (
    CLOCK,
    JOINT_STATES,
    RECORDED_UNTIL,
    RECORDER_STATUS,
    TOPICS,
    Topic,
)
from aerarm_ros.ros.parameters.parameter_table import ParameterError
from aerarm_ros.ros.states.answers import Answers


class LossWatch:
    """Report messages lost since the last report, with advice.

    Parameters
    ----------
    depth
        Queue length of a topic in messages.
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._known: dict[str, int] = {}

    def news(self, heard: Mapping[str, tuple[int, int | None]]) -> str:
        """Return a sentence about newly lost messages, or an empty text.

        Parameters
        ----------
        heard
            Number of received messages, and of lost ones (None if unknown), of each topic so far.
        """
        known = self._known
        self._known = {name: lost or 0 for name, (_, lost) in heard.items()}
        news = {name: lost - known.get(name, 0) for name, lost in self._known.items()}
        losing = {name: count for name, count in news.items() if count > 0}
        if not losing:
            return ''
        counts = ', '.join(f'{count} of {name}' for name, count in losing.items())
        return (
            f'the recorder has just lost messages ({counts}), because this machine is too busy '
            'or its disk too slow: end other programs, record fewer topics (parameter topics), '
            f'or raise the queue length (parameter depth, now {self._depth})'
        )


_UNRECORDED = {topic.name for topic in (RECORDER_STATUS, RECORDED_UNTIL, CLOCK)}
SUITE_TOPICS = tuple(name for name in TOPICS if name not in _UNRECORDED)


def find_topics(entries: Sequence[str]) -> list[Topic]:
    """Return the topics of a list of names.

    Parameters
    ----------
    entries
        Names of the suite's topics, or 'NAME=TYPE', such as 'scan=sensor_msgs/msg/LaserScan'.

    Raises
    ------
    ParameterError
        If the list is empty, repeats a topic, or a name or type is unknown.
    """
    topics = [_find_topic(entry.strip()) for entry in entries]
    if not topics or len({topic.name for topic in topics}) != len(topics):
        raise ParameterError(f'topics = {list(entries)} repeats a topic: name each topic once')
    return topics


def for_recording(topic: Topic, depth: int) -> Topic:
    """Return a topic with a queue of `depth` messages, so that a pause loses no messages."""
    qos = topic.qos
    deep = QoSProfile(depth=depth, reliability=qos.reliability, durability=qos.durability)
    return replace(topic, qos=deep)


def as_recorded(topic: Topic, full_name: str) -> RecordedTopic:
    """Return a topic's description for the bag, with its offered quality of service."""
    return RecordedTopic(
        full_name,
        topic.type_name,
        topic.offered.depth,
        reliable=topic.offered.reliability == ReliabilityPolicy.RELIABLE,
        latched=topic.offered.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    )


def _find_topic(entry: str) -> Topic:
    name, equals, kind = entry.partition('=')
    if equals:
        # Best effort matches publishers of either reliability.
        qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        return Topic(name, _message_class(kind), qos)
    if name not in TOPICS:
        raise ParameterError(
            f'topic {name!r} in parameter topics is unknown: choose from '
            f'{", ".join(SUITE_TOPICS)}, or write NAME=TYPE, for example '
            'scan=sensor_msgs/msg/LaserScan'
        )
    return TOPICS[name]


def _message_class(kind: str) -> Any:
    package, _, name = kind.partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ParameterError(
            f'message type {kind!r} in parameter topics is not installed: check its spelling, '
            'for example sensor_msgs/msg/Imu, and its package'
        ) from error


_STAMP_END = ENCAPSULATION_SIZE + 8
_DISORDER = 1_000_000_000  # [ns] longest correction of a reception time


class BagFeed:
    """Write messages of subscriptions to a bag, and count them.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    topics
        Topics to record, as the bag describes them.
    subscribed
        The topics with the queue lengths of the subscriptions.
    directory, compression
        Directory and compression of the bag.

    Attributes
    ----------
    names
        Full names of the topics.

    Raises
    ------
    ValueError
        If the bag cannot be created.
    """

    def __init__(
        self,
        node: Node,
        topics: Sequence[Topic],
        subscribed: Sequence[Topic],
        directory: str,
        compression: str,
    ) -> None:
        self.names = [node.resolve_topic_name(topic.name) for topic in topics]
        recorded = map(as_recorded, topics, self.names)
        self._writer = BagWriter(directory, list(recorded), compression)
        self._reader = RawReader(node, *subscribed, identify=True)
        self._received = [0] * len(topics)  # reception time of each topic's last message [ns]
        self._states = Answers(needed=False)
        self._states_index = next(
            (index for index, topic in enumerate(topics) if topic.name == JOINT_STATES.name), -1
        )

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s]; return whether a message arrived."""
        return self._reader.wait(timeout)

    def take(self, limit: int) -> None:
        """Write waiting messages to the bag, up to `limit` per topic; raises BagError.

        Without a limit, a slow recorder would never return from this call.
        """
        take, write = self._reader.take, self._writer.write
        for index in range(len(self.names)):
            for _ in range(limit):
                message = take(index)
                if message is None:
                    break
                payload, info = message
                repeats = 0
                if index == self._states_index:
                    if self._states.begin(payload):
                        continue
                    repeats = self._states.count
                received = self._in_order(index, info['received_timestamp'] or time.time_ns())
                write(
                    RecordedMessage(
                        index,
                        payload,
                        received,
                        info['source_timestamp'] or received,
                        # A re-sent state leaves no gap in the numbers.
                        self._number(index, info) - repeats,
                    )
                )

    def _in_order(self, index: int, received: int) -> int:
        """Return a message's reception time [ns], at least that of its topic's last message.

        Bags are read in the order of this time. With several publishers, messages may be read in
        another order than they arrived. A larger step means that the clock was set back, and is
        kept.
        """
        if self._received[index] - received < _DISORDER:
            received = max(received, self._received[index])
        self._received[index] = received
        return received

    def _number(self, index: int, info: dict[str, Any]) -> int:
        """Return a message's number in the bag; gaps in the numbers are lost messages.

        Each publisher numbers its own messages. A bag does not store publishers, so the messages
        of all publishers are numbered in one sequence.
        """
        number: int = info['publication_sequence_number']
        if number in UNNUMBERED or 'publisher' not in info:
            return number
        return self._reader.count(index) + (self._reader.lost(index) or 0)

    def until(self) -> bytes:
        """Return the stamp of the newest joint state as a serialized Time; b'' before the first."""
        # A serialized Time equals the first bytes of a serialized JointState.
        return self._states.state[:_STAMP_END]

    def publishers(self) -> list[int]:
        """Return the number of publishers of each topic."""
        return [self._reader.publishers(k) for k in range(len(self.names))]

    def heard(self) -> dict[str, tuple[int, int | None]]:
        """Return the numbers of received and lost messages (None: unknown) of each topic."""
        read, counts = self._reader, self._writer.counts
        heard = {name: (counts[k], read.lost(k)) for k, name in enumerate(self.names)}
        return {name: numbers for name, numbers in heard.items() if numbers[0]}

    def total_lost(self) -> object:
        """Return the number of lost messages, or 'unknown' if a topic cannot be counted."""
        lost = [lost for _, lost in self.heard().values()]
        return 'unknown' if None in lost else sum(filter(None, lost))

    def written(self) -> tuple[int, int]:
        """Return the number of messages in the bag and their size in bytes."""
        return sum(self._writer.counts), os.fstat(self._writer.fileno()).st_size

    def complete(self) -> None:
        """Write pending messages and complete the bag; raises BagError. May be called twice."""
        self._writer.close()

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()
