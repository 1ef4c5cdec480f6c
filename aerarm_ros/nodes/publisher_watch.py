"""Looks who publishes a topic."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.node import Node

from aerarm_msgs_py.topic import Topic

PERIOD = 0.1  # [s]


class PublisherWatch:
    """Reports the full names of a topic's publishers ten times a second.

    Parameters
    ----------
    node
        Looks from its place in the graph; its executor's thread does.
    topic
        The topic.
    report
        Takes the names.
    """

    def __init__(self, node: Node, topic: Topic, report: Callable[[Sequence[str]], None]) -> None:
        self._node = node
        self._topic = node.resolve_topic_name(topic.name)
        self._report = report
        self._timer = node.create_timer(PERIOD, self._look)

    def destroy(self) -> None:
        """Look no longer."""
        self._node.destroy_timer(self._timer)

    def _look(self) -> None:
        endpoints = self._node.get_publishers_info_by_topic(self._topic)
        self._report([f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in endpoints])
