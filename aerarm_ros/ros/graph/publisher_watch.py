"""Looks who publishes a topic."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rclpy.node import Node

from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.ros.graph.endpoint_name import endpoint_name
from aerarm_ros.ros.graph.endpoint_problem import endpoint_problem

_CYCLES = 100  # between two polls for a reason to look
UNNAMED = 'a new node'
"""In place of the name of a publisher that was found before its node."""


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
        Takes the names of those that reach a subscription, by their GIDs.
    cycles
        Calls of `poll` between two polls for a reason to look.
    known
        Number of publishers that are no reason to look.

    Attributes
    ----------
    problems
        One text for each publisher that does not reach it, with the reason.
    """

    def __init__(
        self,
        node: Node,
        topic: Topic,
        report: Callable[[Mapping[bytes, str]], None],
        cycles: int = _CYCLES,
        known: int = 0,
    ) -> None:
        self.problems: tuple[str, ...] = ()
        self._node = node
        self._topic = topic
        self._name = node.resolve_topic_name(topic.name)
        self._report = report
        self._cycles = cycles
        self._count = known
        self._cycle = 0
        self._wanted = False
        self._reason = node.create_guard_condition(self._look)

    def poll(self) -> None:
        """Notice a change; to be called in every cycle, costs a microsecond."""
        self._cycle += 1
        if self._cycle % self._cycles:
            return
        count = self._node.count_publishers(self._name)
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
        endpoints = self._node.get_publishers_info_by_topic(self._name)
        self._wanted = not all(map(endpoint_name, endpoints))
        names: dict[bytes, str] = {}
        problems = []
        for endpoint in endpoints:
            name = endpoint_name(endpoint) or UNNAMED
            problem = endpoint_problem(endpoint, self._topic)
            if problem:
                problems.append(f'{self._name} of {name} is not heard: {problem}')
            else:
                names[bytes(endpoint.endpoint_gid)] = name
        self.problems = tuple(problems)
        self._report(names)
