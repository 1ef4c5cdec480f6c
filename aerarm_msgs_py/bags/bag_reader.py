"""Functions that read a bag: joint states as arrays, topics, lost messages."""

import warnings
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.bags.bag import Bag
from aerarm_msgs_py.codecs.cdr import CdrReader, diagnostic_values
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateDecoder
from aerarm_msgs_py.sequence_gaps import SequenceGaps
from aerarm_msgs_py.storage.read_limits import (
    BagError,
    BagWarning,
    MessageBlock,
    ReadBudget,
    ReadLimits,
)


@dataclass(frozen=True)
class JointStateSeries:
    """M recorded JointState messages of n joints, as arrays in the order of reception.

    Attributes
    ----------
    names
        Names of the n joints, in column order.
    stamp
        (M,) `header.stamp` [s], also where stamps repeat or jump.
    log_time
        (M,) time at which the recorder received the message [s].
    position, velocity, effort
        (M, n) values of the joints [rad], [rad/s], [Nm]; NaN where a message lacks the joint or the
        field.
    sequence
        (M,) publication sequence numbers, 0 if unknown.
    """

    names: tuple[str, ...]
    stamp: NDArray[np.float64]
    log_time: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]
    sequence: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.stamp)

    def columns(self, names: Sequence[str]) -> 'JointStateSeries':
        """Return a series with only the given joints, in the order of `names`.

        Raises
        ------
        KeyError
            If the series lacks a joint.
        """
        missing = [name for name in names if name not in self.names]
        if missing:
            raise KeyError(
                f'joints {missing} are missing from the recorded joints {list(self.names)}: check '
                'the joint names'
            )
        order = [self.names.index(name) for name in names]
        return replace(
            self,
            names=tuple(names),
            position=self.position[:, order],
            velocity=self.velocity[:, order],
            effort=self.effort[:, order],
        )


@dataclass(frozen=True)
class TopicSummary:
    """Message type, number of messages and number of lost messages of one topic in a bag.

    Attributes
    ----------
    type
        Message type, for example 'sensor_msgs/msg/JointState'.
    messages
        Number of messages in the bag.
    lost
        Number of messages that are missing between the first and the last one in the bag. None if
        the recorder stored no publication sequence numbers.
    """

    type: str
    messages: int
    lost: int | None


_GROWTH = 1.125  # small, because numpy fills with zeros, so unused memory counts too
_FIRST = 4096  # messages
_SINGLE_BYTES = 3000  # counted for a message that is decoded separately, which takes time


class JointStateBuilder:
    """Collector of JointState messages in arrays that grow with every block.

    Large arrays grow in place without copying, so the messages are never in memory twice.

    Parameters
    ----------
    most
        Number of messages to keep, from the start; later messages are only counted.
    thinned
        Number of messages that suffice for plots. At most twice this number is kept, evenly spread
        over the bag. None keeps all messages.
    budget
        Limits of memory for the arrays, and of the time to fill them.

    Attributes
    ----------
    left_out
        Number of messages beyond `most`, which are not in the arrays.
    irregular
        Number of ignored fields whose length was neither 0 nor that of the names.
    """

    def __init__(
        self, most: int | None = None, thinned: int | None = None, budget: ReadBudget | None = None
    ) -> None:
        self.left_out = 0
        self._most = most
        self._thinned = thinned
        self._stride, self._seen = 1, 0  # step between kept messages; number of received messages
        self._decoder = JointStateDecoder()
        self._budget = budget
        self._count = 0
        self._times = np.empty((0, 2), np.int64)  # stamp and receipt time [ns]
        self._sequence = np.empty(0, np.int64)
        self._fields = [np.empty((0, 0)) for _ in range(3)]  # position, velocity, effort

    def __len__(self) -> int:
        return self._count

    @property
    def irregular(self) -> int:
        """Number of position, velocity and effort fields that were ignored for a wrong length."""
        return self._decoder.irregular

    def add(self, block: MessageBlock) -> None:
        """Decode a block of JointState messages and append them to the arrays.

        Raises
        ------
        ValueError
            If a message is not a JointState.
        BagError
            If the budget is exhausted.
        """
        if self._thinned is not None:
            self._thin_out(2 * self._thinned)
        block = self._kept(block)
        if self._most is not None and self._count + len(block.payloads) > self._most:
            self.left_out += len(block.payloads) - (self._most - self._count)
            block = block.chosen(slice(self._most - self._count))
        if not len(block.payloads):
            return
        singly = self._decoder.singly
        stamp_ns, values = self._decoder.decode(block.payloads)
        if self._budget:
            self._budget.spend(values.nbytes + _SINGLE_BYTES * (self._decoder.singly - singly))
        first, last = self._count, self._count + len(stamp_ns)
        self._reserve(last, values.shape[2])
        self._times[first:last, 0] = stamp_ns
        self._times[first:last, 1] = block.log_time
        self._sequence[first:last] = block.sequence
        for k, numbers in enumerate(self._fields):
            numbers[first:last] = values[:, k]
        self._count = last

    def series(self) -> JointStateSeries:
        """Return the collected messages in order of reception, and end the collection."""
        for array in (self._times, self._sequence, *self._fields):
            array.resize((self._count, *array.shape[1:]), refcheck=False)
        self._sort()
        return JointStateSeries(
            names=tuple(self._decoder.names),
            stamp=self._times[:, 0] / 1e9,
            log_time=self._times[:, 1] / 1e9,
            position=self._fields[0],
            velocity=self._fields[1],
            effort=self._fields[2],
            sequence=self._sequence,
        )

    def _sort(self) -> None:
        """Sort the messages by time of reception, if the order in the file differs."""
        log_time = self._times[:, 1]
        if (np.diff(log_time) < 0).any():
            order = np.argsort(log_time, kind='stable')
            self._times, self._sequence = self._times[order], self._sequence[order]
            self._fields = [numbers[order] for numbers in self._fields]

    def _kept(self, block: MessageBlock) -> MessageBlock:
        """Return the messages of a block to keep, one per stride."""
        part = slice(-self._seen % self._stride, None, self._stride)
        self._seen += len(block.payloads)
        return block if self._stride == 1 else block.chosen(part)

    def _thin_out(self, limit: int) -> None:
        """Remove every second kept message and double the stride if `limit` is reached."""
        if self._count < limit:
            return
        before, self._count = self._count, (self._count + 1) // 2
        for array in (self._times, self._sequence, *self._fields):
            array[: self._count] = array[:before:2].copy()
        self._stride *= 2

    def _reserve(self, count: int, joints: int) -> None:
        known = self._fields[0].shape[1]
        if joints > known:  # rare: a joint that earlier messages lack
            missing = np.full((len(self._fields[0]), joints - known), np.nan)
            self._fields = [np.hstack([numbers, missing]) for numbers in self._fields]
        if count > len(self._sequence):
            capacity = max(count, _FIRST, int(_GROWTH * len(self._sequence)))
            for array in (self._times, self._sequence, *self._fields):
                array.resize((capacity, *array.shape[1:]), refcheck=False)


JOINT_STATE = 'sensor_msgs/msg/JointState'
_STRING = 'std_msgs/msg/String'
_DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
_MISSED = 'missed cycles'
_LONGEST = 2**16  # bytes of diagnostics that are read
_TEXT_BYTES = 500  # memory and time of a text without its characters, in bytes
_ENOUGH = 50_000  # messages of an optional topic


@dataclass
class BagContents:
    """Joint states, text messages (such as arm modes) and missed control cycles, read from a bag.

    Attributes
    ----------
    joint_states
        Series of each requested JointState topic that has messages.
    texts
        Time of reception [s] and text of the messages of each requested String topic.
    missed_cycles
        Number of cycles that the bridge missed during the recording; None without diagnostics.
    damaged
        Whether the bag is truncated or damaged.
    expected
        Number of messages of the required topic according to the bag; None if unknown.
    left_out
        Number of messages of the required topic beyond `most`, which were not read.
    """

    joint_states: dict[str, JointStateSeries] = field(default_factory=dict)
    texts: dict[str, list[tuple[float, str]]] = field(default_factory=dict)
    missed_cycles: int | None = None
    damaged: bool = False
    expected: int | None = None
    left_out: int = 0


def read_contents(
    path: Path | str,
    required: str,
    others: Collection[str] = (),
    most: int | None = None,
    limits: ReadLimits | None = None,
) -> BagContents:
    """Read one required JointState topic and optional topics of a bag in one pass.

    Parameters
    ----------
    path
        rosbag2 directory, .mcap, .db3 or .bag file.
    required
        Name of a JointState topic.
    others
        Optional topics of type JointState, String or DiagnosticArray; topics of other types are
        ignored. If an optional JointState topic has very many messages, only some of them are kept,
        evenly spread over the bag.
    most
        Number of messages of the required topic to keep, from the start, to limit the memory.
    limits
        Limits of memory and time for reading.

    Raises
    ------
    BagError
        If the bag or the required topic cannot be read; the message states what to check.
    """
    bag = Bag(path, limits)
    name = '/' + required.lstrip('/')
    builders: dict[str, JointStateBuilder] = {}
    contents = BagContents()
    diagnostics: list[bytes] = []
    for block in bag.messages_and(name, JOINT_STATE, others):
        if block.type == JOINT_STATE:
            if block.topic not in builders:
                thinned = None if block.topic == name else _ENOUGH
                builders[block.topic] = JointStateBuilder(most, thinned, bag.budget)
            _add(builders[block.topic], block, path)
        elif block.type == _STRING:
            _add_texts(contents.texts.setdefault(block.topic, []), block, bag.budget)
        elif block.type == _DIAGNOSTICS:
            diagnostics += [
                message
                for message in block.payloads
                if len(message) < _LONGEST and _MISSED.encode() in message
            ]
            del diagnostics[1:-1]
    contents.joint_states = {topic: builder.series() for topic, builder in builders.items()}
    for texts in contents.texts.values():
        texts.sort(key=itemgetter(0))
    irregular = builders[name].irregular
    if irregular:
        warnings.warn(
            f'topic {name} of the bag {path}: {irregular} fields do not have one value per joint '
            'name and were ignored',
            BagWarning,
            stacklevel=2,
        )
    contents.left_out = builders[name].left_out
    contents.missed_cycles = _missed_between(diagnostics)
    contents.damaged = bag.damaged
    contents.expected = bag.recorded_count(name)
    count = len(contents.joint_states[name]) + contents.left_out
    if contents.expected is None or contents.expected < count:  # no count, or an outdated one
        _warn_lost(contents.joint_states[name], name, path)
    return contents


def lost_messages(sequence: NDArray[np.int64]) -> int | None:
    """Return the number of messages that are missing in M publication sequence numbers.

    The result is None if the recorder stored no sequence numbers.
    """
    if len(sequence) and sequence[0] > 0 and np.all(np.diff(sequence) == 1):
        return 0
    gaps = SequenceGaps()
    gaps.add_all(sequence.tolist())
    return gaps.lost


def _warn_lost(states: JointStateSeries, topic: str, path: Path | str) -> None:
    """Warn if sequence numbers are missing between the first and the last message."""
    if lost := lost_messages(states.sequence):
        warnings.warn(
            f'bag {path}: the sequence numbers show that {lost} messages of topic {topic} are '
            'missing; the recorder lost these messages, or the bag is damaged',
            BagWarning,
            stacklevel=3,
        )


def _add(builder: JointStateBuilder, block: MessageBlock, path: Path | str) -> None:
    try:
        builder.add(block)
    except ValueError as error:
        raise BagError(
            f'topic {block.topic} of the bag {path} cannot be decoded ({error}): check that the '
            'bag is complete'
        ) from error


def _add_texts(texts: list[tuple[float, str]], block: MessageBlock, budget: ReadBudget) -> None:
    times = (block.log_time / 1e9).tolist()
    for time, payload in zip(times, block.payloads, strict=True):
        budget.spend(_TEXT_BYTES + len(payload))
        texts.append((time, _text(payload)))


def _text(payload: bytes) -> str:
    try:
        return CdrReader(payload).string()
    except ValueError:
        return ''


def _missed_between(diagnostics: list[bytes]) -> int | None:
    """Return how many control cycles the bridge missed in the recording; None if unknown."""
    counts = []
    for payload in diagnostics:
        try:
            values = diagnostic_values(payload).values()
            counts += [int(status[_MISSED]) for status in values if _MISSED in status]
        except ValueError:
            continue
    return counts[-1] - counts[0] if counts and counts[-1] >= counts[0] else None


def read_joint_states(
    path: Path | str, topic: str = '/joint_states', limits: ReadLimits | None = None
) -> JointStateSeries:
    """Read all messages of a JointState topic.

    Parameters
    ----------
    path
        rosbag2 directory or .mcap file.
    topic
        Topic name.
    limits
        Limits of memory and time for reading.

    Returns
    -------
    JointStateSeries
        Joints in the order of the first message, followed by joints of later messages.

    Raises
    ------
    BagError
        If the bag or the topic cannot be read; the message states what to check.
    """
    return read_contents(path, topic, limits=limits).joint_states['/' + topic.lstrip('/')]


def topics(path: Path | str) -> dict[str, TopicSummary]:
    """Return type, number of messages and number of lost messages of every topic in a bag.

    Raises
    ------
    BagError
        If the bag cannot be read.
    """
    bag = Bag(path)
    counts: dict[str, int] = {}
    gaps: dict[str, SequenceGaps] = {}
    for block in bag.blocks():
        counts[block.topic] = counts.get(block.topic, 0) + len(block.payloads)
        gaps.setdefault(block.topic, SequenceGaps()).add_all(block.sequence.tolist())
    return {
        topic: TopicSummary(kind, counts.get(topic, 0), gaps.get(topic, SequenceGaps()).lost)
        for topic, kind in bag.types().items()
    }
