"""Notices that a topic which must have one source has several."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node

from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.ros.graph.endpoint_name import endpoint_name
from aerarm_ros.ros.graph.publisher_watch import UNNAMED

OF_AN_ARM = ': stop all but one, or give each arm a namespace or ROS_DOMAIN_ID of its own'
"""What to do about a topic that an arm has."""


def several_publishers(topic: str, names: Sequence[str], advice: str = OF_AN_ARM) -> str:
    """Return who publishes a topic beside whom and what to do, '' if nobody does."""
    if len(names) < 2:
        return ''
    return f'{topic} has {len(names)} publishers, {" and ".join(sorted(names))}{advice}'


class SolePublisher:
    """Looks for a second publisher: with two bridges a node would follow both arms in turns.

    Parameters
    ----------
    node
        Looks from its place in the graph.
    topic
        The topic that only one node should publish.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        self._node = node
        self._topic = node.resolve_topic_name(topic.name)
        self._told = ''

    def problem(self) -> str:
        """Return who publishes beside whom and what to do, '' if nobody does.

        Cheap as long as there is one publisher; names take up to a millisecond.
        """
        if self._node.count_publishers(self._topic) < 2:
            return ''
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        names = [endpoint_name(publisher) or UNNAMED for publisher in publishers]
        return several_publishers(self._topic, names)

    def news(self) -> str:
        """Return the problem if it is another one than the last time, else ''."""
        problem = self.problem()
        is_new, self._told = problem != self._told, problem
        return problem if is_new else ''
