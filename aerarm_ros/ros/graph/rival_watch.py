"""Notices that another node publishes what a node with a loop publishes."""

from __future__ import annotations

from collections.abc import Mapping

from rclpy.node import Node

from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.ros.graph.publisher_watch import UNNAMED, PublisherWatch
from aerarm_ros.ros.graph.sole_publisher import OF_AN_ARM, several_publishers

_CYCLES = 1000  # between two polls: it is a person who has to act


class RivalWatch:
    """Warns, once per change, while a topic has another publisher than its node.

    Parameters
    ----------
    node
        Publishes the topic; its executor's thread looks.
    topic
        The topic that only this node should publish.
    advice
        What to do about several publishers, as `several_publishers` ends.

    Attributes
    ----------
    problem
        Who publishes beside whom and what to do, '' if nobody does.
    """

    def __init__(self, node: Node, topic: Topic, advice: str = OF_AN_ARM) -> None:
        self.problem = ''
        self._advice = advice
        self._topic = node.resolve_topic_name(topic.name)
        self._logger = node.get_logger()
        self._watch = PublisherWatch(node, topic, self._judge, _CYCLES, known=1)

    def poll(self) -> None:
        """Notice a change; to be called in every cycle, costs a microsecond."""
        self._watch.poll()

    def destroy(self) -> None:
        """Watch no longer."""
        self._watch.destroy()

    def _judge(self, publishers: Mapping[bytes, str]) -> None:
        names = list(publishers.values())
        if UNNAMED in names:
            return  # the watch looks again
        problem = several_publishers(self._topic, names, self._advice)
        if problem and problem != self.problem:
            self._logger.warning(problem)
        self.problem = problem
