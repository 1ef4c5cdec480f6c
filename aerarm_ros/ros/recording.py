"""Recording of topics in a bag, with the counts and causes of lost messages."""

from __future__ import annotations

import math
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import import_module
from itertools import takewhile
from pathlib import Path
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
from aerarm_ros.ros.graph import endpoint_name
from aerarm_ros.ros.parameters.parameter_table import ParameterError
from aerarm_ros.ros.states.state_stream import Answers

LINK, DISK, PROCESSOR = 'link', 'disk', 'processor'
"""Causes of lost messages: the network link, the recorder's disk, or its processor."""

_STALL_NS = 50_000_000  # a pass of the recorder's loop normally takes some milliseconds
_JOIN_NS = 1_000_000_000  # one log line reports gaps with the same cause that are closer
_SAMPLE_NS = 100_000_000  # between two readings of the kernel's counter (0.2 ms each)
_OVERFLOW_NS = 1_000_000_000  # time after an overflow in which the middleware empties the buffer
_PASSES = 4096  # passes of the loop that are stored, at least 10 s
_ADVICE = {
    LINK: (
        'the network between both hosts lost messages: record on the host that publishes, for '
        'example with arm record through ground_link'
    ),
    DISK: ('the disk was too slow: record to a faster disk, or fewer topics (parameter topics)'),
    PROCESSOR: (
        'this computer was too busy: end other programs, record fewer topics (parameter topics), '
        'or increase the queue length (parameter depth, {depth} now)'
    ),
}


@dataclass
class Gap:
    """Gap in the received messages, or several gaps with the same cause within one second.

    Attributes
    ----------
    cause
        `LINK`, `DISK` or `PROCESSOR`.
    begin_ns, end_ns
        Reception times of the last message before and the first message after the gap [ns since
        the epoch].
    counts
        Number of lost messages by topic.
    is_overflow
        Whether the kernel dropped datagrams because its receive buffer was full.
    """

    cause: str
    begin_ns: int
    end_ns: int
    counts: dict[str, int]
    is_overflow: bool = False

    def text(self, depth: int) -> str:
        """Return a log line about the gap: lost messages, times, cause and advice."""
        counts = ', '.join(f'{count} of {name}' for name, count in self.counts.items())
        times = [_time_of_day(time_ns) for time_ns in (self.begin_ns, self.end_ns)]
        advice = receive_buffer_advice() if self.is_overflow else _ADVICE[self.cause]
        return (
            f'losing messages: {counts}, from {times[0]} to {times[1]}, cause: {self.cause}: '
            + advice.format(depth=depth)
        )


class LossWatch:
    """Determine the causes of gaps in the received messages, and report each gap once.

    A long pass of the recorder's loop causes a gap. In such a pass, either the disk took most of
    the time, or other programs used the processor. Without a long pass, the network lost messages
    of another host.

    Parameters
    ----------
    depth
        Queue length of a topic in messages.
    dropped
        Returns the number of datagrams that the kernel has dropped because a receive buffer was
        full; by default the number for this host.

    Attributes
    ----------
    last
        Newest reported gap, None before the first.
    """

    def __init__(self, depth: int, dropped: Callable[[], int] | None = None) -> None:
        self._depth = depth
        self._dropped = dropped or dropped_datagrams
        # Times [ns since the epoch] and numbers of dropped datagrams, the first at the start.
        self._drops = deque([(0, self._dropped())], maxlen=_PASSES)
        self._passes: deque[tuple[int, int, int]] = deque(maxlen=_PASSES)
        self._gaps: list[Gap] = []
        self.last: Gap | None = None

    def note_pass(self, begin_ns: int, end_ns: int, disk_ns: int) -> None:
        """Store begin and end of a pass of the recorder's loop, and its time for the disk [ns]."""
        self._passes.append((begin_ns, end_ns, disk_ns))
        if abs(end_ns - self._drops[-1][0]) >= _SAMPLE_NS:
            self._drops.append((end_ns, self._dropped()))

    def note_gap(self, topic: str, count: int, begin_ns: int, end_ns: int, is_remote: bool) -> None:
        """Store a gap between two received messages of a topic, and determine its cause.

        Parameters
        ----------
        topic
            Name of the topic.
        count
            Number of lost messages.
        begin_ns, end_ns
            Reception times of the two messages [ns since the epoch].
        is_remote
            Whether another host publishes the topic.
        """
        cause, is_overflow = self._cause(count, begin_ns, end_ns, is_remote)
        for gap in self._gaps:
            if gap.cause == cause and begin_ns - gap.end_ns < _JOIN_NS:
                gap.begin_ns, gap.end_ns = min(gap.begin_ns, begin_ns), max(gap.end_ns, end_ns)
                gap.counts[topic] = gap.counts.get(topic, 0) + count
                gap.is_overflow |= is_overflow
                return
        self._gaps.append(Gap(cause, begin_ns, end_ns, {topic: count}, is_overflow))

    def news(self) -> list[str]:
        """Return one log line for each gap that no earlier call has reported."""
        gaps, self._gaps = self._gaps, []
        if gaps:
            self.last = gaps[-1]
        return [gap.text(self._depth) for gap in gaps]

    def _cause(self, count: int, begin_ns: int, end_ns: int, is_remote: bool) -> tuple[str, bool]:
        if is_remote:
            self._drops.append((end_ns, self._dropped()))
            if self._drops[-1][1] > self._dropped_until(begin_ns - _OVERFLOW_NS):
                return PROCESSOR, True
        recent = takewhile(lambda a_pass: a_pass[1] > begin_ns, reversed(self._passes))
        overlapping = [(end - begin, disk) for begin, end, disk in recent if begin < end_ns]
        longest, disk = max(overlapping, default=(0, 0))
        # Number of messages that arrived during the longest pass, at the rate of the lost ones.
        waiting = count * longest / max(end_ns - begin_ns, 1)
        if is_remote and (longest < _STALL_NS or waiting < 0.5 * self._depth):
            return LINK, False
        return (DISK if longest > _STALL_NS and 2 * disk > longest else PROCESSOR), False

    def _dropped_until(self, time_ns: int) -> int:
        """Return how many datagrams were dropped until `time_ns` [ns since the epoch]."""
        samples = (count for sampled_ns, count in reversed(self._drops) if sampled_ns <= time_ns)
        return next(samples, self._drops[0][1])


def _time_of_day(time_ns: int) -> str:
    return f'{datetime.fromtimestamp(1e-9 * time_ns):%H:%M:%S.%f}'[:-3]


def dropped_datagrams() -> int:
    """Return how many UDP datagrams the kernel has dropped because of full receive buffers."""
    try:
        lines = Path('/proc/net/snmp').read_text().splitlines()
    except OSError:
        return 0
    names, numbers = (line.split() for line in lines if line.startswith('Udp:'))
    return int(dict(zip(names, numbers, strict=True)).get('RcvbufErrors', '0'))


_DATAGRAM = 1280  # bytes of kernel memory for a message of a few hundred bytes
_DELAY = 0.25  # [s] by which a busy processor may delay the middleware's thread
_BUFFERS = ('rmem_default', 'rmem_max')


def receive_buffer_need(streams: int) -> int:
    """Return the receive buffer of the kernel that `streams` topics at 1 kHz need [bytes]."""
    return math.ceil(streams * 1000 * _DELAY * _DATAGRAM)


def receive_buffer_advice(need: int = 0) -> str:
    """Return advice with a command that enlarges the kernel's receive buffers to `need` [bytes]."""
    need = max(need, 2 * _receive_buffer())
    settings = ' '.join(f'net.core.{name}={need}' for name in _BUFFERS)
    return (
        f"the kernel's receive buffers were full: enlarge them with 'sudo sysctl -w {settings}', "
        'and restart the recorder'
    )


def receive_buffer_problem(streams: int) -> str:
    """Return a warning if the kernel's receive buffers are too small, or an empty string.

    `streams` is the number of topics at 1 kHz. Only messages of other hosts need the buffers,
    because messages of this host use shared memory.
    """
    need, have = receive_buffer_need(streams), _receive_buffer()
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
_HOST = 4  # bytes of a DDS identifier: vendor and host
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
        self._reader = RawReader(node, *subscribed, identify=True)
        self._received = [0] * len(topics)  # reception time of each topic's last message [ns]
        self._lost = [0] * len(topics)
        self._is_stream = [
            topic.qos.reliability == ReliabilityPolicy.BEST_EFFORT for topic in topics
        ]
        self._host: bytes | None = None
        self._passed_ns, self._disk = time.time_ns(), 0.0
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
        self._note_pass()
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

    def _note_pass(self) -> None:
        """Report begin, end and disk time of the last pass of the recorder's loop."""
        now_ns, disk = time.time_ns(), self._writer.disk_time
        self._losses.note_pass(self._passed_ns, now_ns, int(1e9 * (disk - self._disk)))
        self._passed_ns, self._disk = now_ns, disk

    def _note_gap(self, index: int, missing: int, info: dict[str, Any]) -> None:
        """Report a gap if messages of the topic were lost before the present message."""
        news, self._lost[index] = missing - self._lost[index], missing
        if news <= 0:
            return  # messages that seemed lost have arrived late
        end = info['received_timestamp'] or time.time_ns()
        begin = self._received[index] or end
        name, is_remote = self.names[index], self._is_remote(info.get('publisher'))
        self._losses.note_gap(name, news, min(begin, end), end, is_remote)

    def _is_remote(self, publisher: bytes | None) -> bool:
        """Return whether a publisher runs on another host, according to its DDS identifier."""
        if publisher is None:
            return False
        if self._host is None:
            own = self._node.get_fully_qualified_name()
            ends = self._node.get_subscriptions_info_by_topic(self.names[0])
            gids = [bytes(end.endpoint_gid) for end in ends if endpoint_name(end) == own]
            if not gids:
                return False
            self._host = gids[0][:_HOST]
        return publisher[:_HOST] != self._host

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
        if number in UNNUMBERED or 'publisher' not in info:
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
