"""Notices publishers whose messages a recorder will never see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.ros.graph.endpoint_name import endpoint_name


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
            f'{name} of {node} is not recorded: it is {publisher.topic_type}, expected is '
            f'{topic.type_name}'
        )
    elif (
        wanted.reliability == ReliabilityPolicy.RELIABLE
        and qos.reliability == ReliabilityPolicy.BEST_EFFORT
    ):
        yield f'{name} of {node} is not recorded: it is best effort, make it reliable'
    elif (
        wanted.durability == DurabilityPolicy.TRANSIENT_LOCAL
        and qos.durability == DurabilityPolicy.VOLATILE
    ):
        yield f'{name} of {node} is not recorded: it is volatile, make it transient local'
