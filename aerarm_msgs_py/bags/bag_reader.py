"""What the suite asks of a bag: joint states as arrays, topics, lost messages."""

import warnings
from collections.abc import Iterator
from pathlib import Path

from aerarm_msgs_py.bags.bag import Bag
from aerarm_msgs_py.bags.bag_contents import JOINT_STATE, read_contents
from aerarm_msgs_py.bags.joint_state_series import JointStateSeries
from aerarm_msgs_py.bags.topic_summary import TopicSummary
from aerarm_msgs_py.codecs.joint_state_decoder import JointStateDecoder
from aerarm_msgs_py.live_topics.sequence_gaps import SequenceGaps
from aerarm_msgs_py.storage.bag_error import BagError, BagWarning
from aerarm_msgs_py.storage.read_limits import ReadLimits

__all__ = [
    'BagError',
    'BagWarning',
    'JointStateSeries',
    'TopicSummary',
    'joint_state_blocks',
    'read_joint_states',
    'topics',
]


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
        What reading may take, whatever the bag holds.

    Returns
    -------
    JointStateSeries
        Joints in the order of the first message; joints that turn up later follow.

    Raises
    ------
    BagError
        If the bag or the topic can't be read; the message says what to check.
    """
    return read_contents(path, topic, limits=limits).joint_states['/' + topic.lstrip('/')]


def joint_state_blocks(
    path: Path | str, topic: str = '/joint_states'
) -> Iterator[JointStateSeries]:
    """Yield the messages of a JointState topic part by part, for bags larger than memory.

    Columns only ever grow: the names of a part begin with those of the part before.
    Parameters and errors are those of `read_joint_states`.
    """
    decoder = JointStateDecoder()
    for block in Bag(path).messages(topic, JOINT_STATE):
        try:
            stamp_ns, values = decoder.decode(block.payloads)
        except ValueError as error:
            raise BagError(f'topic {topic} of {path} cannot be decoded: {error}') from error
        yield JointStateSeries(
            names=tuple(decoder.names),
            stamp=stamp_ns / 1e9,
            log_time=block.log_time / 1e9,
            position=values[:, 0],
            velocity=values[:, 1],
            effort=values[:, 2],
            sequence=block.sequence,
        )
    if decoder.irregular:
        warnings.warn(
            f'{decoder.irregular} fields of topic {topic} of {path} were left out: their length '
            'was not that of the names',
            BagWarning,
            stacklevel=2,
        )


def topics(path: Path | str) -> dict[str, TopicSummary]:
    """Return type, number of messages and of lost messages of every topic in a bag.

    Raises
    ------
    BagError
        If the bag can't be read.
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
