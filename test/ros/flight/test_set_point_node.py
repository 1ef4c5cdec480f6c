"""A set point node with an autopilot whose message package is installed."""

import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import AccelStamped, QuaternionStamped, WrenchStamped
from quick_spinning import release_nodes, spin_once

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


@pytest.fixture
def flown(ros_domain: dict[str, str]) -> Iterator[AcceleratedDrone]:
    drone = resource('config', 'drone.yaml')
    rclpy.init(args=['--ros-args', '-p', f'drone_file:={drone}'])
    try:
        flown = AcceleratedDrone()
        yield flown
        release_nodes()
        flown.close()
    finally:
        rclpy.shutdown()


def test_a_clock_offset_of_the_arm_is_reported(flown: AcceleratedDrone) -> None:
    node, problems = rclpy.create_node('test'), ['']
    set_points, attitudes, motion = (
        node.create_publisher(kind, name, 1)
        for kind, name in (
            (AccelStamped, 'set_point'),
            (QuaternionStamped, 'attitude'),
            (WrenchStamped, topics.MOTION_WRENCH.name),
        )
    )
    topic = topics.DIAGNOSTICS
    node.create_subscription(
        topic.type, topic.name, lambda m: problems.append(m.status[0].message), topic.qos
    )

    def fly_until(condition: Callable[[], object], ahead: float) -> None:
        """Fly on with 1 N on the drone, and an arm whose time is some seconds ahead."""
        deadline, wrench = time.monotonic() + LIMIT, WrenchStamped()
        wrench.wrench.force.x = 1.0
        while not condition():
            assert time.monotonic() < deadline, problems
            stamp_ns = node.get_clock().now().nanoseconds + round(1e9 * ahead)
            wrench.header.stamp.sec, wrench.header.stamp.nanosec = divmod(stamp_ns, 10**9)
            set_points.publish(AccelStamped())
            attitudes.publish(QuaternionStamped())
            motion.publish(wrench)
            spin_once(node, 0.005)
            for _ in range(10):
                spin_once(flown.node, 0.001)

    fly_until(lambda: 'in order' in problems and np.any(flown.added), 0.0)
    for ahead, said in (
        (-1.5, "the arm's time is 1.5 s behind this computer's"),
        (1.5, "the arm's time is 1.5 s ahead of this computer's"),
        (-0.12, "the arm's forecast is 0.1"),  # 0.15 s with feed_lead, and the way here
    ):
        fly_until(lambda said=said: said in problems[-1], ahead)
        assert 'pace:=real_time' in problems[-1]
    node.destroy_node()
