"""What the arm will do next, on a topic."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from builtin_interfaces.msg import Duration
from numpy.typing import NDArray
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.ros.states.base_header import base_header

HORIZON = 0.1
"""How far ahead a plan goes [s]: a drone's rotors and link want some 30 ms."""
_POINT_PERIOD = 0.02  # [s] quintics between points are near enough
_PERIOD_NS = 10_000_000  # between two plans

_TIMES = np.linspace(0.0, HORIZON, round(HORIZON / _POINT_PERIOD) + 1)
_SECOND = 1_000_000_000


class PlanTopic:
    """Publishes the motion of the next 0.1 s, a hundred times a second of the arm's time.

    Its `update` is called in the loop's thread, once a command is sent, so that it delays none. It
    is an `Attendant` of a controller.

    Parameters
    ----------
    node
        Owner of the publisher.
    joint_names
        In the order of all arrays.
    stamp_ns
        Returns the stamp of the newest state [ns], None before the first.
    ahead
        Returns the references (M, n) at times (M,) after that state [s], None while nobody knows.
    """

    def __init__(
        self,
        node: Node,
        joint_names: Sequence[str],
        stamp_ns: Callable[[], int | None],
        ahead: Callable[[NDArray[np.float64]], JointReference | None],
    ) -> None:
        self._node = node
        self._stamp_ns = stamp_ns
        self._ahead = ahead
        self._told_ns = -_PERIOD_NS
        topic = topics.PLANNED_MOTION
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        self._message = JointTrajectory(joint_names=list(joint_names))
        self._message.points = [
            JointTrajectoryPoint(time_from_start=Duration(nanosec=round(time * _SECOND)))
            for time in _TIMES.tolist()
        ]

    def update(self) -> None:
        """Publish if it is due and somebody listens."""
        stamp_ns = self._stamp_ns()
        if stamp_ns is None or 0 <= stamp_ns - self._told_ns < _PERIOD_NS:
            return
        self._told_ns = stamp_ns
        if not self._publisher.get_subscription_count():
            return  # it would cost the loop a tenth of its time for nobody
        plan = self._ahead(_TIMES)
        if plan is None:
            return
        message = self._message
        message.header = base_header(stamp_ns, '')
        for point, q, dq, ddq in zip(message.points, *map(np.ndarray.tolist, plan), strict=True):
            point.positions, point.velocities, point.accelerations = q, dq, ddq
        self._publisher.publish(message)

    def give_up(self, reason: str) -> None:
        """Say nothing: an arm that is not controlled has no plan."""

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)
