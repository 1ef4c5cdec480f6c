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
from aerarm_msgs_py.sequence_gaps import lost_messages
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


_SINGLE_BYTES = 3000  # counted for a message that is decoded separately, which takes time


class JointStateBuilder:
    """Collector of the JointState messages of consecutive blocks.

    Parameters
    ----------
    most
        Number of messages to keep, from the start; later messages are only counted.
    stride
        Only every `stride`-th message is kept.
    budget
        Limits of memory for the arrays, and of the time to fill them.

    Attributes
    ----------
    left_out
        Number of messages beyond `most`, which are not in the arrays.
    """

    def __init__(
        self, most: int | None = None, stride: int = 1, budget: ReadBudget | None = None
    ) -> None:
        self.left_out = 0
        self._most = most
        self._stride, self._seen = stride, 0
        self._decoder = JointStateDecoder()
        self._budget = budget
        self._count = 0  # kept messages
        # Per block: stamp and receipt time [ns], sequence numbers; then position, velocity, effort.
        self._integers: list[list[NDArray[np.int64]]] = [[], [], []]
        self._fields: list[list[NDArray[np.float64]]] = [[], [], []]

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
        if self._stride > 1:
            part = slice(-self._seen % self._stride, None, self._stride)
            self._seen += len(block.payloads)
            block = block.chosen(part)
        if self._most is not None and self._count + len(block.payloads) > self._most:
            self.left_out += len(block.payloads) - (self._most - self._count)
            block = block.chosen(slice(self._most - self._count))
        if not len(block.payloads):
            return
        singly = self._decoder.singly
        stamp_ns, values = self._decoder.decode(block.payloads)
        if self._budget:
            self._budget.spend(values.nbytes + _SINGLE_BYTES * (self._decoder.singly - singly))
        self._count += len(stamp_ns)
        rows = stamp_ns, block.log_time, block.sequence
        for parts, numbers in zip(self._integers, rows, strict=True):
            parts.append(numbers)
        for k, fields in enumerate(self._fields):
            fields.append(values[:, k].copy())

    def series(self) -> JointStateSeries:
        """Return the collected messages in order of reception, and end the collection."""
        stamp_ns, log_time, sequence = map(np.concatenate, self._integers)
        order = None if (np.diff(log_time) >= 0).all() else np.argsort(log_time, kind='stable')
        whole = slice(None) if order is None else order
        position, velocity, effort = (self._joined(parts)[whole] for parts in self._fields)
        return JointStateSeries(
            names=tuple(self._decoder.names),
            stamp=stamp_ns[whole] / 1e9,
            log_time=log_time[whole] / 1e9,
            position=position,
            velocity=velocity,
            effort=effort,
            sequence=sequence[whole],
        )

    def _joined(self, parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return the blocks of a field as one array, and free their memory."""
        joined = np.full((self._count, len(self._decoder.names)), np.nan)
        first = 0
        for part in parts:  # early blocks may lack joints of later ones
            joined[first : first + len(part), : part.shape[1]] = part
            first += len(part)
        parts.clear()
        return joined


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
                expected = 0 if block.topic == name else bag.recorded_count(block.topic) or 0
                stride = max(1, expected // _ENOUGH)
                builders[block.topic] = JointStateBuilder(most, stride, bag.budget)
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


def _warn_lost(states: JointStateSeries, topic: str, path: Path | str) -> None:
    """Warn if sequence numbers are missing between the first and the last message."""
    if lost := lost_messages(states.sequence.tolist()):
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
