"""A controller's rejections, seen by the client."""

from collections.abc import Iterator

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.requests.motion_request import RejectionWatch


def status(mode: str, count: int, reason: str) -> DiagnosticArray:
    values = {'arm mode': mode, 'rejected inputs': str(count), 'last rejection': reason}
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(name='a_controller', values=pairs)])


@pytest.fixture
def reports(ros_node: Node) -> Iterator[list[DiagnosticArray]]:
    """What a controller reports, one after the other and the last again and again."""
    told: list[DiagnosticArray] = []
    topic = topics.DIAGNOSTICS
    publisher = ros_node.create_publisher(topic.type, topic.name, topic.offered)

    def tell() -> None:
        publisher.publish(told.pop(0) if len(told) > 1 else told[0])

    timer = ros_node.create_timer(0.05, tell)
    yield told
    ros_node.destroy_timer(timer)


def test_waits_for_a_controller_that_has_not_received_the_mode(
    ros_node: Node, reports: list[DiagnosticArray]
) -> None:
    early = [status('', count, "the arm is 'unknown'") for count in range(4)]
    reports += [*early, status('ready', 3, "the arm is 'unknown'")]
    watch = RejectionWatch(ros_node)
    watch.begin(60.0)
    assert len(reports) == 1  # the last, of a controller that takes references
    assert watch.reason() == ''


def test_the_reason_of_a_rejection_is_returned(
    ros_node: Node, reports: list[DiagnosticArray]
) -> None:
    reports += [status('ready', 1, 'before')]
    watch = RejectionWatch(ros_node)
    watch.begin(60.0)
    assert watch.reason() == ''
    reports[:] = [status('ready', 2, 'too far')]
    assert spin_until(ros_node, watch.reason, 60.0)
    assert watch.reason() == 'too far'
