"""Which topics a recorder subscribes to, and how."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from aerarm_msgs_py.bags.recorded_topic import RecordedTopic
from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_msgs_py.topics import CLOCK, RECORDED_UNTIL, RECORDER_STATUS, TOPICS
from aerarm_ros.ros.parameters.parameter_table import ParameterError

_UNRECORDED = {topic.name for topic in (RECORDER_STATUS, RECORDED_UNTIL, CLOCK)}
SUITE_TOPICS = tuple(name for name in TOPICS if name not in _UNRECORDED)


def find_topics(entries: Sequence[str]) -> list[Topic]:
    """Return the topics of a list of names.

    Parameters
    ----------
    entries
        Names of the suite's topics, or 'NAME=TYPE', as 'scan=sensor_msgs/msg/LaserScan'.

    Raises
    ------
    ParameterError
        If the list is empty, repeats a topic, or a name or type isn't known.
    """
    topics = [_find_topic(entry.strip()) for entry in entries]
    if not topics or len({topic.name for topic in topics}) != len(topics):
        raise ParameterError(f'parameter topics = {list(entries)}: give each topic once')
    return topics


def for_recording(topic: Topic, depth: int) -> Topic:
    """Return a topic with a history of `depth` messages, so that a pause loses nothing."""
    qos = topic.qos
    deep = QoSProfile(depth=depth, reliability=qos.reliability, durability=qos.durability)
    return replace(topic, qos=deep)


def as_recorded(topic: Topic, full_name: str) -> RecordedTopic:
    """Return how the bag describes a topic: as it is offered, and as a player should offer it."""
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
            f'parameter topics: {name!r} is none of {", ".join(SUITE_TOPICS)}; for another topic '
            'give NAME=TYPE, as scan=sensor_msgs/msg/LaserScan'
        )
    return TOPICS[name]


def _message_class(kind: str) -> Any:
    package, _, name = kind.partition('/msg/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError, TypeError, ValueError) as error:
        raise ParameterError(
            f'parameter topics: message type {kind!r} is not installed: check its spelling, '
            'as sensor_msgs/msg/Imu, and its package'
        ) from error
