"""What one motion of the arm left in a bag, read in one pass."""

import warnings
from collections.abc import Collection
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.bags.bag import Bag
from aerarm_msgs_py.bags.joint_state_builder import JointStateBuilder
from aerarm_msgs_py.bags.joint_state_series import JointStateSeries
from aerarm_msgs_py.codecs.cdr_reader import CdrReader
from aerarm_msgs_py.codecs.diagnostics_cdr import diagnostic_values
from aerarm_msgs_py.live_topics.sequence_gaps import SequenceGaps
from aerarm_msgs_py.storage.bag_error import BagError, BagWarning
from aerarm_msgs_py.storage.message_block import MessageBlock
from aerarm_msgs_py.storage.read_limits import ReadBudget, ReadLimits

JOINT_STATE = 'sensor_msgs/msg/JointState'
_STRING = 'std_msgs/msg/String'
_DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
_MISSED = 'missed cycles'
_LONGEST = 2**16  # bytes of diagnostics that are looked at
_TEXT_BYTES = 500  # what a text takes beside its characters, and the time to make one
_ENOUGH = 50_000  # messages of a topic that is only looked at beside the required one


@dataclass
class BagContents:
    """Joint states and what the bridge said meanwhile.

    Attributes
    ----------
    joint_states
        Series of each JointState topic that was asked for and has messages.
    texts
        Time of reception [s] and text of the messages of each String topic asked for.
    missed_cycles
        Cycles that the bridge missed during the recording; None if no diagnostics say so.
    damaged
        Whether some of the bag could not be read: its end is missing, or a part is damaged.
    expected
        Messages of the required topic that the bag's own account lists; None without one.
    left_out
        Messages of the required topic beyond the most that were asked for.
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
    """Read several topics of a bag at once, each by its type.

    Parameters
    ----------
    path
        rosbag2 directory, .mcap, .db3 or .bag file.
    required
        A JointState topic.
    others
        Topics that may be missing: JointState, String or DiagnosticArray; those of other
        types are passed over. Of very many JointStates only some are kept, evenly spread.
    most
        Messages to keep of the required topic, the first ones: bounds the memory that a bag
        of any size takes.
    limits
        What reading may take, whatever the bag holds.

    Raises
    ------
    BagError
        If the bag or the required topic can't be read; the message says what to check.
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
            f'{irregular} fields of topic {name} of {path} were left out: their length '
            'was not that of the names',
            BagWarning,
            stacklevel=2,
        )
    contents.left_out = builders[name].left_out
    contents.missed_cycles = _missed_between(diagnostics)
    contents.damaged = bag.damaged
    contents.expected = bag.recorded_count(name)
    count = len(contents.joint_states[name]) + contents.left_out
    if contents.expected is None or contents.expected < count:  # no account, or an early one
        _tell_lost(contents.joint_states[name], name, path)
    return contents


def lost_messages(sequence: NDArray[np.int64]) -> int | None:
    """Return how many numbers are missing from (M,) publication sequence numbers.

    None if the recorder stored no numbers.
    """
    if len(sequence) and sequence[0] > 0 and np.all(np.diff(sequence) == 1):
        return 0
    gaps = SequenceGaps()
    gaps.add_all(sequence.tolist())
    return gaps.lost


def _tell_lost(states: JointStateSeries, topic: str, path: Path | str) -> None:
    """Warn of messages that are missing by their numbers, where no account tells."""
    if lost := lost_messages(states.sequence):
        warnings.warn(
            f'{path}: {lost} messages of {topic} are missing between its first and its last one, '
            'by their numbers: the recorder lost them, or the bag was damaged',
            BagWarning,
            stacklevel=3,
        )


def _add(builder: JointStateBuilder, block: MessageBlock, path: Path | str) -> None:
    try:
        builder.add(block)
    except ValueError as error:
        raise BagError(f'topic {block.topic} of {path} cannot be decoded: {error}') from error


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
    """Return by how much the bridge's count grew from the first to the last message."""
    counts = []
    for payload in diagnostics:
        try:
            values = diagnostic_values(payload).values()
            counts += [int(status[_MISSED]) for status in values if _MISSED in status]
        except ValueError:
            continue
    return counts[-1] - counts[0] if counts and counts[-1] >= counts[0] else None
