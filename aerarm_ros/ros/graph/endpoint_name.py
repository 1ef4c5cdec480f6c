"""Who is at the other end of a topic."""

from rclpy.topic_endpoint_info import TopicEndpointInfo

_UNKNOWN = '_NODE_NAME_UNKNOWN_'  # an endpoint that was found before its node


def endpoint_name(endpoint: TopicEndpointInfo) -> str:
    """Return the full name of an endpoint's node, '' while that is not known."""
    if endpoint.node_name == _UNKNOWN:
        return ''
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
