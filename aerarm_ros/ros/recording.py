"""Recording of topics in a bag, with the counts of lost messages."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.cdr import ENCAPSULATION_SIZE
from aerarm_msgs_py.live_topics import UNNUMBERED, RawReader
from aerarm_msgs_py.topics import (
    CLOCK,
    JOINT_STATES,
    RECORDED_UNTIL,
    RECORDER_STATUS,
    TOPICS,
    Topic,
)
from aerarm_ros.ros.parameters.parameter_table import ParameterError
from aerarm_ros.ros.states.state_stream import Answers

_UNRECORDED = {topic.name for topic in (RECORDER_STATUS, RECORDED_UNTIL, CLOCK)}
SUITE_TOPICS = tuple(name for name in TOPICS if name not in _UNRECORDED)


def find_topics(entries: Sequence[str]) -> list[Topic]:
    """Return the topics to record, from the entries of the recorder's parameter `topics`.

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
        raise ParameterError(
            f'parameter topics = {list(entries)} is empty or repeats a topic: name at least one '
            'topic, and name each topic once'
        )
    return topics


def as_recorded(topic: Topic, full_name: str) -> RecordedTopic:
    """Return a topic's description in the bag, with the quality of service of its publisher."""
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
            f'message type {kind!r} in parameter topics is not installed: install its package, or '
            'correct the spelling, for example to sensor_msgs/msg/Imu'
        ) from error


_STAMP_END = ENCAPSULATION_SIZE + 8
_DISORDER = 1_000_000_000  # [ns] longest correction of a reception time


class BagFeed:
    """Subscribe to topics, write their messages to a bag, and count them.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    topics
        Topics to record.
    depth
        Length of the receive queue of each topic.
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
        self, node: Node, topics: Sequence[Topic], depth: int, directory: str, compression: str
    ) -> None:
        self.names = [node.resolve_topic_name(topic.name) for topic in topics]
        recorded = map(as_recorded, topics, self.names)
        self._writer = BagWriter(directory, list(recorded), compression)
        self._reader = RawReader(node, *(topic.queued(depth) for topic in topics))
        self._received = [0] * len(topics)  # reception time of each topic's last message [ns]
        self._told = dict.fromkeys(self.names, 0)  # lost messages that `losses` has returned
        self._is_stream = [
            topic.qos.reliability == ReliabilityPolicy.BEST_EFFORT for topic in topics
        ]
        self._states = Answers(needed=False)
        self._states_index = next(
            (index for index, topic in enumerate(topics) if topic.name == JOINT_STATES.name), -1
        )

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; return whether one arrived."""
        return self._reader.wait(timeout)

    def take(self, limit: int) -> None:
        """Write received messages to the bag, at most `limit` per topic; raises BagError.

        The limit ensures that the call ends, even if messages arrive faster than it writes them.
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
                    repeats = self._states.count  # a re-sent state leaves no gap in the numbers
                received = self._in_order(index, info['received_timestamp'] or time.time_ns())
                sent = info['source_timestamp'] or received
                number = self._number(index, info['publication_sequence_number']) - repeats
                write(RecordedMessage(index, payload, received, sent, number))

    def _in_order(self, index: int, received: int) -> int:
        """Return a message's reception time [ns], not before that of the topic's last message.

        Readers of bags sort messages by reception time. With several publishers, the recorder may
        read messages in another order than they arrived. If the time decreases by more than 1 s,
        the clock was set back, so the time is not changed.
        """
        if self._received[index] - received < _DISORDER:
            received = max(received, self._received[index])
        self._received[index] = received
        return received

    def _number(self, index: int, number: int) -> int:
        """Return the sequence number of a message for the bag, with gaps for lost messages.

        Each publisher numbers its own messages. A bag does not store publishers, so the bag has one
        sequence of numbers per topic.
        """
        if number in UNNUMBERED:
            return number
        return self._reader.count(index) + (self._reader.lost(index) or 0)

    def until(self) -> bytes:
        """Return the newest joint state's stamp as a serialized Time, b'' without a joint state."""
        # A serialized Time equals the first bytes of a serialized JointState.
        return self._states.state[:_STAMP_END]

    def publishers(self) -> list[int]:
        """Return the number of publishers of each topic."""
        return [self._reader.publishers(k) for k in range(len(self.names))]

    def message_counts(self) -> dict[str, tuple[int, int | None]]:
        """Return each topic's numbers of received and lost messages; None for an unknown loss."""
        read, counts = self._reader, self._writer.counts
        totals = {name: (counts[k], read.lost(k)) for k, name in enumerate(self.names)}
        return {name: numbers for name, numbers in totals.items() if numbers[0]}

    def losses(self) -> dict[str, int]:
        """Return each topic's number of messages that were lost since the last call, if any."""
        lost = {name: lost or 0 for name, (_, lost) in self.message_counts().items()}
        news = {name: count - self._told[name] for name, count in lost.items()}
        self._told |= lost
        return {name: count for name, count in news.items() if count > 0}

    def silent(self) -> list[str]:
        """Return the best-effort topics that have a publisher but no received message.

        Either the publisher has sent no message, or all messages were lost. Only a received message
        shows how many messages before it are missing.
        """
        counts = self._writer.counts
        return [
            name
            for k, name in enumerate(self.names)
            if self._is_stream[k] and not counts[k] and self._reader.publishers(k)
        ]

    def total_lost(self) -> object:
        """Return the number of lost messages, or 'at least N' if a topic's loss is unknown."""
        lost = [lost for _, lost in self.message_counts().values()]
        total = sum(filter(None, lost))
        return f'at least {total}' if None in lost or self.silent() else total

    @property
    def waiting(self) -> int:
        """Number of received messages that are not yet written to the disk."""
        return self._writer.waiting

    def written(self) -> tuple[int, int]:
        """Return the number of messages in the bag, and the size of its file [bytes]."""
        return sum(self._writer.counts), os.fstat(self._writer.fileno()).st_size

    def complete(self) -> None:
        """Write pending messages and complete the bag; raises BagError, may be called twice."""
        self._writer.close()

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()
