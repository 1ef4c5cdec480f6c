"""Why a publisher does not reach a subscription."""

from __future__ import annotations

from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo

from aerarm_msgs_py.live_topics.topic import Topic


def endpoint_problem(publisher: TopicEndpointInfo, topic: Topic) -> str:
    """Return why a publisher's messages never come, '' if they do.

    The middleware is silent about another type, and what it says about another quality of
    service goes to executors that run the subscription.
    """
    if publisher.topic_type != topic.type_name:
        return f'it is {publisher.topic_type}, expected is {topic.type_name}'
    compatibility, reason = qos_check_compatible(publisher.qos_profile, topic.qos)
    if compatibility == QoSCompatibility.ERROR:
        return f'its quality of service does not fit: {reason}'
    return ''
