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

_STALL_NS = 50_000_000  # a pass of the recorder's loop normally takes some milliseconds
_JOIN_NS = 1_000_000_000  # one log line reports gaps with the same cause that are closer
_PASSES = 4096  # passes of the loop that are stored, at least 10 s
_LINK, _DISK, _PROCESSOR, _OVERFLOW = 'link', 'disk', 'processor', 'processor (full buffer)'
_ADVICE = {
    _LINK: 'the network between both hosts lost messages: record on the host that publishes, for '
    'example with arm record through ground_link',
    _DISK: 'the disk was too slow: record to a faster disk, or fewer topics (parameter topics)',
    _PROCESSOR: 'this computer was too busy: end other programs, record fewer topics (parameter '
    'topics), or increase the queue length (parameter depth, {depth} now)',
    _OVERFLOW: "the kernel's receive buffer was full: enlarge it with {command}, and restart the "
    'recorder',
}


@dataclass
class Gap:
    """Gap in the received messages, or several gaps with the same cause within one second.

    Attributes
    ----------
    cause
        Cause: 'link', 'disk', 'processor' or 'processor (full buffer)'.
    begin_ns, end_ns
        Reception times of the last message before and the first message after the gap [ns since
        the epoch].
    counts
        Number of lost messages by topic.
    """

    cause: str
    begin_ns: int
    end_ns: int
    counts: dict[str, int]

    def text(self, depth: int) -> str:
        """Return a log line about the gap: lost messages, times, cause and advice."""
        counts = ', '.join(f'{count} of {name}' for name, count in self.counts.items())
        begin, end = (
            f'{datetime.fromtimestamp(1e-9 * time_ns):%H:%M:%S.%f}'[:-3]
            for time_ns in (self.begin_ns, self.end_ns)
        )
        advice = _ADVICE[self.cause].format(depth=depth, command=_sysctl(2 * _receive_buffer()))
        return f'losing messages: {counts}, from {begin} to {end}, cause: {self.cause}: {advice}'


class LossWatch:
    """Finder of the causes of gaps in the received messages, which reports each gap once.

    A long pass of the recorder's loop causes a gap. In such a pass, either the disk took most of
    the time, or other programs used the processor. Without a long pass, the network lost messages
    of another host, or the kernel's receive buffer was full.

    Parameters
    ----------
    depth
        Queue length of a topic in messages.
    dropped
        Returns the number of datagrams that the kernel has dropped because a receive buffer was
        full; by default the number for this host.

    Attributes
    ----------
    cause
        Cause of the newest reported gap, '' before the first.
    """

    def __init__(self, depth: int, dropped: Callable[[], int] | None = None) -> None:
        self.cause = ''
        self._depth = depth
        self._dropped = dropped or _dropped_datagrams
        # At the last two calls of `news`: the middleware empties a full buffer within a second.
        self._drops = deque([self._dropped()], maxlen=2)
        self._passes: deque[tuple[int, int, int]] = deque(maxlen=_PASSES)
        self._gaps: list[Gap] = []

    def note_pass(self, begin_ns: int, end_ns: int, disk_ns: int) -> None:
        """Store begin and end of a pass of the recorder's loop, and its time for the disk [ns]."""
        self._passes.append((begin_ns, end_ns, disk_ns))

    def note_gap(self, topic: str, count: int, begin_ns: int, end_ns: int, is_remote: bool) -> None:
        """Store a gap of `count` messages between two received messages of a topic.

        `begin_ns` and `end_ns` are the reception times of the two messages [ns since the epoch].
        `is_remote` states whether another host publishes the topic.
        """
        cause = self._cause(count, begin_ns, end_ns, is_remote)
        for gap in self._gaps:
            if gap.cause == cause and begin_ns - gap.end_ns < _JOIN_NS:
                gap.begin_ns, gap.end_ns = min(gap.begin_ns, begin_ns), max(gap.end_ns, end_ns)
                gap.counts[topic] = gap.counts.get(topic, 0) + count
                return
        self._gaps.append(Gap(cause, begin_ns, end_ns, {topic: count}))

    def news(self) -> list[str]:
        """Return one log line for each gap that no earlier call has reported.

        Call this method once per second: it also reads the number of dropped datagrams.
        """
        self._drops.append(self._dropped())
        gaps, self._gaps = self._gaps, []
        if gaps:
            self.cause = gaps[-1].cause
        return [gap.text(self._depth) for gap in gaps]

    def _cause(self, count: int, begin_ns: int, end_ns: int, is_remote: bool) -> str:
        if is_remote and self._dropped() > self._drops[0]:
            return _OVERFLOW
        recent = takewhile(lambda a_pass: a_pass[1] > begin_ns, reversed(self._passes))
        overlapping = [(end - begin, disk) for begin, end, disk in recent if begin < end_ns]
        longest, disk = max(overlapping, default=(0, 0))
        # Number of messages that arrived during the longest pass, at the rate of the lost ones.
        waiting = count * longest / max(end_ns - begin_ns, 1)
        if is_remote and (longest < _STALL_NS or waiting < 0.5 * self._depth):
            return _LINK
        return _DISK if longest > _STALL_NS and 2 * disk > longest else _PROCESSOR


def _dropped_datagrams() -> int:
    """Return how many UDP datagrams the kernel has dropped because of full receive buffers."""
    try:
        lines = Path('/proc/net/snmp').read_text().splitlines()
    except OSError:  # not Linux
        return 0
    names, numbers = (line.split() for line in lines if line.startswith('Udp:'))
    return int(dict(zip(names, numbers, strict=True)).get('RcvbufErrors', '0'))


_DATAGRAM = 1280  # bytes of kernel memory for a message of a few hundred bytes
_DELAY = 0.25  # [s] by which a busy processor may delay the middleware's thread


def receive_buffer_problem(streams: int) -> str:
    """Return a warning if the kernel's receive buffers are too small, or an empty string.

    `streams` is the number of topics at 1 kHz. Only messages of other hosts need the buffers,
    because messages of this host use shared memory.
    """
    need, have = math.ceil(streams * 1000 * _DELAY * _DATAGRAM), _receive_buffer()
    if have >= need:
        return ''
    return (
        f"the kernel's receive buffer has {have} bytes, but {streams} topics at 1 kHz from other "
        f'hosts need {need} bytes: run {_sysctl(need)} before you start the recorder'
    )


def _sysctl(size: int) -> str:
    """Return the command that sets the kernel's receive buffers to `size` bytes."""
    return f"'sudo sysctl -w net.core.rmem_default={size} net.core.rmem_max={size}'"


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
_HOST = 4  # bytes of a DDS identifier: vendor and host


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
    losses
        Gaps in the received messages, and their causes.

    Raises
    ------
    ValueError
        If the bag cannot be created.
    """

    def __init__(
        self, node: Node, topics: Sequence[Topic], depth: int, directory: str, compression: str
    ) -> None:
        self._node = node
        self.losses = LossWatch(depth)
        self.names = [node.resolve_topic_name(topic.name) for topic in topics]
        recorded = map(as_recorded, topics, self.names)
        self._writer = BagWriter(directory, list(recorded), compression)
        self._reader = RawReader(node, *(topic.queued(depth) for topic in topics), identify=True)
        self._received = [0] * len(topics)  # reception time of each topic's last message [ns]
        self._lost = [0] * len(topics)
        self._host = b''
        self._passed_ns, self._disk = time.time_ns(), 0.0
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
        self._note_pass()
        for index in range(len(self.names)):
            for _ in range(limit):
                message = take(index)
                if message is None:
                    break
                payload, info = message
                previous = self._received[index]
                received = self._in_order(index, info['received_timestamp'] or time.time_ns())
                missing = self._reader.lost(index) or 0
                if missing != self._lost[index]:
                    news, self._lost[index] = missing - self._lost[index], missing
                    begin = min(previous or received, received)
                    is_remote = self._is_remote(info['publisher'])
                    self.losses.note_gap(self.names[index], news, begin, received, is_remote)
                repeats = 0
                if index == self._states_index:
                    if self._states.begin(payload):
                        continue
                    repeats = self._states.count  # a re-sent state leaves no gap in the numbers
                sent = info['source_timestamp'] or received
                number = self._number(index, info['publication_sequence_number']) - repeats
                write(RecordedMessage(index, payload, received, sent, number))

    def _note_pass(self) -> None:
        """Report begin, end and disk time of the last pass of the recorder's loop."""
        now_ns, disk = time.time_ns(), self._writer.disk_time
        self.losses.note_pass(self._passed_ns, now_ns, int(1e9 * (disk - self._disk)))
        self._passed_ns, self._disk = now_ns, disk

    def _is_remote(self, publisher: bytes) -> bool:
        """Return whether a publisher runs on another host, according to its DDS identifier."""
        if not self._host:
            own = self._node.get_fully_qualified_name()
            ends = self._node.get_subscriptions_info_by_topic(self.names[0])
            gids = (bytes(end.endpoint_gid) for end in ends if endpoint_name(end) == own)
            self._host = next(gids, b'')[:_HOST]
        return self._host not in (b'', publisher[:_HOST])

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
