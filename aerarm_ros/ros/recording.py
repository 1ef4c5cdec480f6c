"""Recording of topics in a bag, with the counts of lost messages."""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import import_module
from pathlib import Path
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

_JOIN_NS = 1_000_000_000  # one log line reports gaps that are closer


@dataclass
class Gap:
    """Gap in the received messages, or several gaps within one second.

    Attributes
    ----------
    begin_ns, end_ns
        Reception times of the last message before and the first message after the gap [ns since
        the epoch].
    counts
        Number of lost messages by topic.
    """

    begin_ns: int
    end_ns: int
    counts: dict[str, int]

    def text(self, depth: int) -> str:
        """Return a log line about the gap: lost messages, times and advice."""
        counts = ', '.join(f'{count} of {name}' for name, count in self.counts.items())
        times = [_time_of_day(time_ns) for time_ns in (self.begin_ns, self.end_ns)]
        return (
            f'losing messages: {counts}, from {times[0]} to {times[1]}: end other programs, record '
            'fewer topics (parameter topics) or to a faster disk, or increase the queue length '
            f'(parameter depth, {depth} now). Record topics of another host there, for example '
            'with arm record through ground_link'
        )


class LossWatch:
    """Collector of gaps in the received messages, which reports each gap once.

    Parameters
    ----------
    depth
        Queue length of a topic in messages.
    """

    def __init__(self, depth: int) -> None:
        self._depth = depth
        self._gaps: list[Gap] = []

    def note_gap(self, topic: str, count: int, begin_ns: int, end_ns: int) -> None:
        """Store a gap of `count` messages between two received messages of a topic.

        `begin_ns` and `end_ns` are the reception times of the two messages [ns since the epoch].
        """
        for gap in self._gaps:
            if begin_ns - gap.end_ns < _JOIN_NS:
                gap.begin_ns, gap.end_ns = min(gap.begin_ns, begin_ns), max(gap.end_ns, end_ns)
                gap.counts[topic] = gap.counts.get(topic, 0) + count
                return
        self._gaps.append(Gap(begin_ns, end_ns, {topic: count}))

    def news(self) -> list[str]:
        """Return one log line for each gap that no earlier call has reported."""
        gaps, self._gaps = self._gaps, []
        return [gap.text(self._depth) for gap in gaps]


def _time_of_day(time_ns: int) -> str:
    return f'{datetime.fromtimestamp(1e-9 * time_ns):%H:%M:%S.%f}'[:-3]


_DATAGRAM = 1280  # bytes of kernel memory for a message of a few hundred bytes
_DELAY = 0.25  # [s] by which a busy processor may delay the middleware's thread
_BUFFERS = ('rmem_default', 'rmem_max')


def receive_buffer_problem(streams: int) -> str:
    """Return a warning if the kernel's receive buffers are too small, or an empty string.

    `streams` is the number of topics at 1 kHz. Only messages of other hosts need the buffers,
    because messages of this host use shared memory.
    """
    need, have = math.ceil(streams * 1000 * _DELAY * _DATAGRAM), _receive_buffer()
    if have >= need:
        return ''
    settings = ' '.join(f'net.core.{name}={need}' for name in _BUFFERS)
    return (
        f"the kernel's receive buffer has {have} bytes, but {streams} topics at 1 kHz from other "
        f"hosts need {need} bytes: run 'sudo sysctl -w {settings}' before you start the recorder"
    )


def _receive_buffer() -> int:
    try:
        return int(Path('/proc/sys/net/core/rmem_default').read_text())
    except (OSError, ValueError):  # not Linux
        return sys.maxsize // 4


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
        Topics to record, as the bag describes them.
    subscribed
        The same topics, with the queue lengths for the subscriptions.
    directory, compression
        Directory and compression of the bag.
    losses
        Object to which this class reports gaps.

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
        losses: LossWatch,
    ) -> None:
        self._node = node
        self._losses = losses
        self.names = [node.resolve_topic_name(topic.name) for topic in topics]
        recorded = map(as_recorded, topics, self.names)
        self._writer = BagWriter(directory, list(recorded), compression)
        self._reader = RawReader(node, *subscribed)
        self._received = [0] * len(topics)  # reception time of each topic's last message [ns]
        self._lost = [0] * len(topics)
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
        take, write, lost = self._reader.take, self._writer.write, self._reader.lost
        for index in range(len(self.names)):
            for _ in range(limit):
                message = take(index)
                if message is None:
                    break
                payload, info = message
                missing = lost(index) or 0
                if missing != self._lost[index]:
                    self._note_gap(index, missing, info)
                repeats = 0
                if index == self._states_index:
                    if self._states.begin(payload):
                        self._received[index] = info['received_timestamp']
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

    def _note_gap(self, index: int, missing: int, info: dict[str, Any]) -> None:
        """Report a gap if messages of the topic were lost before the present message."""
        news, self._lost[index] = missing - self._lost[index], missing
        if news <= 0:
            return  # messages that seemed lost have arrived late
        end = info['received_timestamp'] or time.time_ns()
        begin = self._received[index] or end
        self._losses.note_gap(self.names[index], news, min(begin, end), end)

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

    def _number(self, index: int, info: dict[str, Any]) -> int:
        """Return the sequence number of a message for the bag, with gaps for lost messages.

        Each publisher numbers its own messages. A bag does not store publishers, so the bag has one
        sequence of numbers per topic.
        """
        number: int = info['publication_sequence_number']
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
