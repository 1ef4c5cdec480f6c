"""The ROS graph: endpoints, publishers and duplicate publishers."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, ReliabilityPolicy, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from aerarm_msgs_py.topics import Topic

_UNKNOWN = '_NODE_NAME_UNKNOWN_'  # an endpoint that was found before its node


def endpoint_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node, '' while that is not known."""
    if endpoint.node_name == _UNKNOWN:
        return ''
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def endpoint_problem(publisher: TopicEndpointInfo, topic: Topic) -> str:
    """Return why a publisher's messages never come, '' if they do.

    The middleware is silent about another type, and what it says about another quality of
    service goes to executors that run the subscription.
    """
    if publisher.topic_type != topic.type_name:
        return f'its type is {publisher.topic_type} instead of {topic.type_name}'
    compatibility, reason = qos_check_compatible(publisher.qos_profile, topic.qos)
    if compatibility == QoSCompatibility.ERROR:
        return f'its quality of service is incompatible: {reason}'
    return ''


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


class PublisherCheck:
    """Compares publishers with what is subscribed to; the middleware is silent about types.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    topics
        What is subscribed to, as it is.
    """

    def __init__(self, node: Node, topics: Sequence[Topic]) -> None:
        self._node = node
        self._topics = [(node.resolve_topic_name(topic.name), topic) for topic in topics]
        self._told: set[str] = set()

    def news(self, matched: Sequence[int]) -> list[str]:
        """Return what has been found since the last time.

        Parameters
        ----------
        matched
            How many publishers each subscription is matched with, in the topics' order.
        """
        found = [
            text
            for (name, topic), count in zip(self._topics, matched, strict=True)
            if self._node.count_publishers(name) > count
            for endpoint in self._node.get_publishers_info_by_topic(name)
            if endpoint_name(endpoint)  # else soon
            for text in _problems(name, topic, endpoint)
        ]
        news = [text for text in dict.fromkeys(found) if text not in self._told]
        self._told.update(news)
        return news


def _problems(name: str, topic: Topic, publisher: TopicEndpointInfo) -> Iterator[str]:
    node = endpoint_name(publisher)
    qos, wanted = publisher.qos_profile, topic.qos
    if publisher.topic_type != topic.type_name:
        yield (
            f'{name} of {node} is not recorded: its type is {publisher.topic_type} instead of '
            f'{topic.type_name}'
        )
    elif (
        wanted.reliability == ReliabilityPolicy.RELIABLE
        and qos.reliability == ReliabilityPolicy.BEST_EFFORT
    ):
        yield (
            f'{name} of {node} is not recorded, because it is best effort: make the '
            'publisher reliable'
        )
    elif (
        wanted.durability == DurabilityPolicy.TRANSIENT_LOCAL
        and qos.durability == DurabilityPolicy.VOLATILE
    ):
        yield (
            f'{name} of {node} is not recorded, because it is volatile: make the publisher '
            'transient local'
        )


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
                problems.append(f'{self._name} of {name} is not received: {problem}')
            else:
                names[bytes(endpoint.endpoint_gid)] = name
        self.problems = tuple(problems)
        self._report(names)


OF_AN_ARM = ': stop all but one, or give each arm its own namespace or ROS_DOMAIN_ID'
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


_DUPLICATE_CYCLES = 1000  # between two polls: it is a person who has to act


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
        self._watch = PublisherWatch(node, topic, self._judge, _DUPLICATE_CYCLES, known=1)

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
