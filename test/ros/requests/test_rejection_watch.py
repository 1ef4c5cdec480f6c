"""A controller's rejections, seen by the client."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.ros.executors import spin_until
from aerarm_ros.ros.requests.motion_request import RejectionWatch


def status(mode: str, count: int, reason: str) -> DiagnosticArray:
    values = {'arm mode': mode, 'rejected inputs': str(count), 'last rejection': reason}
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(name='a_controller', values=pairs)])


def test_waits_for_the_mode_and_returns_the_reason_of_a_rejection(ros_node: Node) -> None:
    # What a controller reports: it has not received the mode at first, and repeats the last.
    early = [status('', count, "the arm is 'unknown'") for count in range(4)]
    reports = [*early, status('ready', 3, "the arm is 'unknown'")]
    publisher = topics.DIAGNOSTICS.publisher(ros_node)

    def report() -> None:
        publisher.publish(reports.pop(0) if len(reports) > 1 else reports[0])

    ros_node.create_timer(0.05, report)
    watch = RejectionWatch(ros_node)
    watch.begin(60.0)
    assert len(reports) == 1
    assert watch.reason() == ''
    reports[:] = [status('ready', 4, 'too far')]
    assert spin_until(ros_node, watch.reason, 60.0)
    assert watch.reason() == 'too far'
