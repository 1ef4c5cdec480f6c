"""Checks of the ROS graph: which nodes publish a topic, and whether their messages arrive."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from math import inf

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from aerarm_msgs_py.topics import Topic

_UNKNOWN = '_NODE_NAME_UNKNOWN_'  # name of an endpoint that was discovered before its node


def endpoint_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node, or an empty string before its discovery."""
    if endpoint.node_name == _UNKNOWN:
        return ''
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def listeners(node: Node, topic: str) -> list[str]:
    """Return the full names of the nodes that subscribe to a topic; '' for an undiscovered node."""
    return [endpoint_name(end) for end in node.get_subscriptions_info_by_topic(topic)]


def can_move(name: str) -> bool:
    """Return whether a node may move the arm: recorder and page subscribe, but move nothing."""
    return name.rpartition('/')[2] not in ('', 'recorder', 'view')


def endpoint_problem(publisher: TopicEndpointInfo, topic: Topic) -> str:
    """Return why messages of a publisher do not reach a subscription, or an empty string.

    The middleware does not report a wrong message type. It reports an incompatible quality of
    service only to an executor that runs the subscription.
    """
    if publisher.topic_type != topic.type_name:
        return (
            f'its type is {publisher.topic_type} instead of {topic.type_name}: rename the topic of '
            'that node'
        )
    compatibility, reason = qos_check_compatible(publisher.qos_profile, topic.qos)
    if compatibility == QoSCompatibility.ERROR:
        return (
            f'its quality of service is incompatible ({reason}): publish the topic with '
            f'reliability {topic.qos.reliability.name} and durability {topic.qos.durability.name}'
        )
    return ''


_PATIENCE = 10.0  # [s] without states of an emulated arm, whose host may pause
_LOOKS = 0.1  # [s] between two checks
_PROCESS = 12  # bytes of a DDS GUID that identify its participant
_CLOCK = 'rosgraph_msgs/msg/Clock'


def is_emulated(node: Node, topic: str) -> bool:
    """Return whether all publishers of a topic are emulated arms.

    A publisher that also publishes a clock is an emulated arm. Its simulation time pauses while its
    host is busy. The result is False if the topic has no publisher. The call takes a few
    milliseconds at most.

    Parameters
    ----------
    node
        Node with which the ROS graph is read.
    topic
        Full name of the topic, for example of joint_states.
    """
    # Search by type, because each emulated arm may publish its clock under another topic name.
    names = [name for name, types in node.get_topic_names_and_types() if _CLOCK in types]
    clocks = [clock for name in names for clock in node.get_publishers_info_by_topic(name)]
    ends = node.get_publishers_info_by_topic(topic)
    return bool(ends) and all(any(_is_of_one_node(end, clock) for clock in clocks) for end in ends)


def _is_of_one_node(one: TopicEndpointInfo, other: TopicEndpointInfo) -> bool:
    names = endpoint_name(one), endpoint_name(other)
    if all(names):
        return names[0] == names[1]
    # Discovery reports an endpoint and its node separately, possibly seconds apart.
    return bytes(one.endpoint_gid[:_PROCESS]) == bytes(other.endpoint_gid[:_PROCESS])


class SilencePatience:
    """Determine the time without joint states after which a bridge counts as ended.

    This time is longer for an emulated arm, because its simulation may pause.

    Parameters
    ----------
    node, topic
        Arguments of `is_emulated`.
    """

    def __init__(self, node: Node, topic: str) -> None:
        self._node = node
        self._topic = topic
        self._looked = -inf
        self._is_emulated = False

    def limit(self, timeout: float) -> float:
        """Return the longest accepted time without joint states [s], `timeout` for a real arm.

        To be called while no joint states arrive. The method reads the graph at most ten times per
        second. After the end of a bridge the topic has no publisher, so the limit is `timeout`.
        """
        now = time.monotonic()
        if now - self._looked > _LOOKS:
            self._looked, self._is_emulated = now, is_emulated(self._node, self._topic)
        return max(timeout, _PATIENCE) if self._is_emulated else timeout


class PublisherCheck:
    """Find publishers whose messages the recorder cannot receive, and the reason."""

    def __init__(self, node: Node, topics: Sequence[Topic]) -> None:
        self._node = node
        self._topics = [(node.resolve_topic_name(topic.name), topic) for topic in topics]
        self._reported: set[str] = set()

    def news(self, matched: Sequence[int]) -> list[str]:
        """Return one message for each unrecordable publisher that no earlier call has reported.

        Parameters
        ----------
        matched
            Number of matched publishers per subscription, in the order of the topics.
        """
        news = []
        for (name, topic), count in zip(self._topics, matched, strict=True):
            if self._node.count_publishers(name) <= count:
                continue
            for endpoint in self._node.get_publishers_info_by_topic(name):
                node, problem = endpoint_name(endpoint), endpoint_problem(endpoint, topic)
                if not (node and problem):  # one of the next calls reports a node without name
                    continue
                text = f'{name} of {node} is not recorded: {problem}'
                if text not in self._reported:
                    self._reported.add(text)
                    news.append(text)
        return news


_CYCLES = 100  # between two checks
UNNAMED = 'a new node'
"""Name in messages for a publisher whose node is not discovered yet."""


class PublisherWatch:
    """Report the names of all nodes that publish a topic, after each change.

    Reading the graph takes up to 1 ms of the interpreter's time, which is a whole cycle of a loop.
    PublisherWatch therefore reads the graph only after `look_soon`, after the number of publishers
    has changed, or while a name is unknown. The middleware's event for a new publisher is not
    suitable, because every message of the topic would wake the waiting thread.

    Parameters
    ----------
    node
        Node whose executor's thread reads the graph.
    report
        Called with the names of the nodes whose messages arrive, by the publishers' GIDs.
    cycles
        Number of calls of `poll` between two checks.
    known
        Number of publishers that the caller already knows.

    Attributes
    ----------
    problems
        One text for each publisher whose messages do not arrive, with the reason.
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
        """Check for changed publishers in every `cycles`-th call; takes 1 us."""
        self._cycle += 1
        if self._cycle % self._cycles:
            return
        count = self._node.count_publishers(self._name)
        if count != self._count or self._wanted:
            self._count, self._wanted = count, False
            self._reason.trigger()

    def look_soon(self) -> None:
        """Read the graph at the next check, even if the number of publishers is unchanged."""
        self._wanted = True

    def destroy(self) -> None:
        """Destroy the guard condition that lets the executor read the graph."""
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


OF_AN_ARM = ': stop all but one, or start each arm with a different namespace or ROS_DOMAIN_ID'
"""Advice at the end of a warning about several publishers of an arm's topic."""


def several_publishers(topic: str, names: Sequence[str], advice: str = OF_AN_ARM) -> str:
    """Return a warning if a topic has several publishers, otherwise an empty string."""
    if len(names) < 2:
        return ''
    return f'{topic} has {len(names)} publishers, {" and ".join(sorted(names))}{advice}'


class DuplicatePublisherCheck:
    """Detect several publishers of a topic, for example two bridges that publish joint states.

    Parameters
    ----------
    node
        Node with which the ROS graph is read.
    topic
        Topic that only one node should publish.
    """

    def __init__(self, node: Node, topic: Topic) -> None:
        self._node = node
        self._topic = node.resolve_topic_name(topic.name)
        self._reported = ''

    def problem(self) -> str:
        """Return a warning that names the duplicate publishers, or an empty string.

        The call is fast with one publisher. With several publishers it takes up to 1 ms.
        """
        if self._node.count_publishers(self._topic) < 2:
            return ''
        publishers = self._node.get_publishers_info_by_topic(self._topic)
        names = [endpoint_name(publisher) or UNNAMED for publisher in publishers]
        return several_publishers(self._topic, names)

    def news(self) -> str:
        """Return the warning of `problem` if it is new since the last call, or an empty string."""
        problem = self.problem()
        is_new, self._reported = problem != self._reported, problem
        return problem if is_new else ''


_DUPLICATE_CYCLES = 1000  # between two checks, because the user's reaction takes longer


class DuplicatePublisherWatch(PublisherWatch):
    """Log a warning whenever another node starts to publish a topic of this node.

    Parameters
    ----------
    node
        Publisher of the topic; its executor's thread reads the graph.
    topic
        Topic that only this node should publish.
    advice
        Advice at the end of the warning, as for `several_publishers`.

    Attributes
    ----------
    problem
        Warning that names the duplicate publishers; empty if there are none.
    """

    def __init__(self, node: Node, topic: Topic, advice: str = OF_AN_ARM) -> None:
        super().__init__(node, topic, self._judge, _DUPLICATE_CYCLES, known=1)
        self.problem = ''
        self._advice = advice
        self._logger = node.get_logger()

    def _judge(self, publishers: Mapping[bytes, str]) -> None:
        names = list(publishers.values())
        if UNNAMED in names:
            return  # `PublisherWatch` reports again once it has read the name.
        problem = several_publishers(self._name, names, self._advice)
        if problem and problem != self.problem:
            self._logger.warning(problem)
        self.problem = problem
