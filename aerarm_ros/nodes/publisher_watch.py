"""Looks who publishes a topic."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.node import Node

from aerarm_msgs_py.topic import Topic

_CYCLES = 100  # between two polls for a reason to look
_UNKNOWN = '_NODE_NAME_UNKNOWN_'  # a publisher found before its node


class PublisherWatch:
    """Reports the full names of a topic's publishers.

    Looking takes up to a millisecond of the interpreter's time, a whole cycle of a loop
    beside it, so it is done when the number of publishers changes, while a name is unknown,
    and when `look_soon` asks for it. The middleware's event of a new publisher would not do:
    a thread that waits for it is woken by every message of the topic as well.

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
        self._count = 0
        self._cycle = 0
        self._wanted = False
        self._reason = node.create_guard_condition(self._look)

    def poll(self) -> None:
        """Notice a change; to be called in every cycle, costs a microsecond."""
        self._cycle += 1
        if self._cycle % _CYCLES:
            return
        count = self._node.count_publishers(self._topic)
        if count != self._count or self._wanted:
            self._count, self._wanted = count, False
            self._reason.trigger()

    def look_soon(self) -> None:
        """Look after some cycles."""
        self._wanted = True

    def destroy(self) -> None:
        """Look no longer."""
        self._node.destroy_guard_condition(self._reason)

    def _look(self) -> None:
        endpoints = self._node.get_publishers_info_by_topic(self._topic)
        self._wanted = any(e.node_name == _UNKNOWN for e in endpoints)
        self._report([f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in endpoints])
