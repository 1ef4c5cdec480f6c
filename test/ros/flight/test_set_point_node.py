"""A set point node with an autopilot whose message package is installed."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped, QuaternionStamped, WrenchStamped
from quick_spinning import release_nodes, spin_once
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.flight.set_point_node import SetPointNode, set_point_parameters

LIMIT = 60.0  # [s]


class AcceleratedDrone(SetPointNode):
    """Sends what is added."""

    def __init__(self) -> None:
        parameters = set_point_parameters('set_point', 'output', 'attitude')
        super().__init__('feedforward', parameters, 'geometry_msgs', '')
        self.added = np.zeros(3)

    def message_types(self):
        return AccelStamped, QuaternionStamped

    def attitude(self, message: QuaternionStamped) -> np.ndarray:
        q = message.quaternion
        return np.array([q.x, q.y, q.z, q.w])

    def with_acceleration(self, set_point, acceleration, now_ns: int) -> AccelStamped:
        self.added = acceleration
        return set_point


class AdvisedFlight:
    """The node, its autopilot, and an arm whose time is some seconds ahead of the clock."""

    def __init__(self, node: Node, flown: AcceleratedDrone) -> None:
        self.node, self.flown = node, flown
        self.ahead = 0.0  # [s]
        self.problems: list[str] = []
        self._set_points = node.create_publisher(AccelStamped, 'set_point', 1)
        self._attitudes = node.create_publisher(QuaternionStamped, 'attitude', 1)
        topic = topics.MOTION_WRENCH
        self._motion = node.create_publisher(topic.type, topic.name, topic.offered)
        topic = topics.DIAGNOSTICS
        node.create_subscription(topic.type, topic.name, self._on_diagnostics, topic.qos)

    def until(self, condition: Callable[[], object]) -> None:
        """Fly on until a condition is true, with 1 N on the drone."""
        deadline = time.monotonic() + LIMIT
        while not condition():
            assert time.monotonic() < deadline, self.problems
            self._set_points.publish(AccelStamped())
            self._attitudes.publish(QuaternionStamped())
            stamp_ns = self.node.get_clock().now().nanoseconds + round(1e9 * self.ahead)
            wrench = WrenchStamped()
            wrench.header.stamp.sec, wrench.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            wrench.wrench.force.x = 1.0
            self._motion.publish(wrench)
            spin_once(self.node, 0.005)
            for _ in range(10):
                spin_once(self.flown.node, 0.001)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.problems += [status.message for status in message.status]


@pytest.fixture
def flight(ros_domain: dict[str, str]) -> Iterator[AdvisedFlight]:
    drone = resource('config', 'drone.yaml')
    rclpy.init(args=['--ros-args', '-p', f'drone_file:={drone}'])
    try:
        flight = AdvisedFlight(rclpy.create_node('test'), AcceleratedDrone())
        yield flight
        release_nodes()
        flight.flown.close()
        flight.node.destroy_node()
    finally:
        rclpy.shutdown()


def test_a_clock_offset_of_the_arm_is_reported(flight: AdvisedFlight) -> None:
    flight.until(lambda: 'in order' in flight.problems and np.any(flight.flown.added))
    for ahead, said in (
        (-1.5, "the arm's time is 1.5 s behind this computer's"),
        (1.5, "the arm's time is 1.5 s ahead of this computer's"),
        (-0.12, "the arm's forecast is 0.1"),  # 0.15 s with feed_lead, and the way here
    ):
        flight.ahead = ahead
        flight.until(lambda said=said: said in flight.problems[-1])
        assert 'pace:=real_time' in flight.problems[-1]
