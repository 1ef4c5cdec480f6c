"""Whether what a node hears comes from an emulated arm."""

from __future__ import annotations

import time
from math import inf

from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo

from aerarm_ros.ros.graph.endpoint_name import endpoint_name

_PATIENCE = 10.0  # [s] for an emulated arm whose host pauses
_LOOKS = 0.1  # [s]
_PROCESS = 12  # bytes of a DDS GUID that are those of its participant
_CLOCK = 'rosgraph_msgs/msg/Clock'


def is_emulated(node: Node, topic: str) -> bool:
    """Return whether each node that publishes a topic publishes a clock too, under any name.

    An arm that does has a time of its own, which stands still when its host is busy. False if
    nobody publishes the topic. Takes milliseconds at most.

    Parameters
    ----------
    node
        Looks from its place in the graph.
    topic
        Full name, of joint_states for example.
    """
    # By type: of two arms each has a clock with a name of its own, which only its bridge is told.
    names = [name for name, types in node.get_topic_names_and_types() if _CLOCK in types]
    clocks = [clock for name in names for clock in node.get_publishers_info_by_topic(name)]
    ends = node.get_publishers_info_by_topic(topic)
    return bool(ends) and all(any(_is_of_one_node(end, clock) for clock in clocks) for end in ends)


def _is_of_one_node(one: TopicEndpointInfo, other: TopicEndpointInfo) -> bool:
    names = endpoint_name(one), endpoint_name(other)
    if all(names):
        return names[0] == names[1]
    # Who an endpoint belongs to is told apart from it, and may come seconds later.
    return bytes(one.endpoint_gid[:_PROCESS]) == bytes(other.endpoint_gid[:_PROCESS])


class SilencePatience:
    """How long an arm may be silent: one whose own time may stand still for longer than others.

    Parameters
    ----------
    node, topic
        As of `is_emulated`.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._topic = topic
        self._looked = -inf
        self._is_emulated = False

    def limit(self, timeout: float) -> float:
        """Return how long [s] the arm may be silent, if `timeout` [s] is for one in real time.

        To be asked while it is silent; looks in the graph ten times a second at most. A bridge
        that has ended publishes nothing any more, and is not waited for.
        """
        now = time.monotonic()
        if now - self._looked > _LOOKS:
            self._looked, self._is_emulated = now, is_emulated(self._node, self._topic)
        return max(timeout, _PATIENCE) if self._is_emulated else timeout
