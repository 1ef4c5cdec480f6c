"""Motions that a person asks for on the page, as topics for the controller that runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.motion.smooth_step import rest_to_rest_duration
from aerarm_ros.ros.graph.endpoint_name import endpoint_name

Array = NDArray[np.float64]

_SHORTEST = 0.5  # [s]
# The controller starts where it wants the arm, which is not quite where the arm is: at the whole of
# a limit the way from there would be refused.
_OF_LIMITS = 0.95
# They hear everything, and move nothing.
_LISTENERS = ('recorder', 'view')


class PageMotion:
    """Publishes postures to go to, and places for the tool.

    Parameters
    ----------
    node
        Owner of the publishers.
    config
        The arm, its limits.
    base
        Link in which the tool's place is given.
    """

    def __init__(self, node: Node, config: ArmConfig, base: str) -> None:
        self._node = node
        self._names = list(config.joint_names)
        self._base = base
        self._velocity_max = np.array(config.column('velocity_max'))
        self._acceleration_max = np.array(config.column('acceleration_max'))
        self._trajectories, self._targets = (
            node.create_publisher(topic.type, topic.name, topic.offered)
            for topic in (topics.JOINT_TRAJECTORY, topics.TOOL_TRAJECTORY)
        )

    def go(self, start: Array, goal: Sequence[float], share: float) -> tuple[bool, str]:
        """Send the arm from joint angles to others, (n,) [rad] each.

        Parameters
        ----------
        start, goal
            Where it is, and where it shall be.
        share
            Of the speed limits, that no joint exceeds on the way.

        Returns
        -------
        sent, text
            Whether somebody listens, and what to tell.
        """
        if not self._is_heard(topics.JOINT_TRAJECTORY.name):
            return False, 'no controller follows joints: start computed_torque'
        share *= _OF_LIMITS
        duration = rest_to_rest_duration(
            np.asarray(goal) - start,
            share * self._velocity_max,
            share * self._acceleration_max,
            _SHORTEST,
        )
        point = JointTrajectoryPoint(positions=[float(angle) for angle in goal])
        point.time_from_start = Duration(seconds=duration).to_msg()
        self._trajectories.publish(JointTrajectory(joint_names=self._names, points=[point]))
        return True, f'on the way, {duration:.1f} s'

    def aim(self, place: Sequence[float]) -> tuple[bool, str]:
        """Send the tool to a place (3,) [m] in the base; returns as `go`."""
        if not self._is_heard(topics.TOOL_TRAJECTORY.name):
            return False, 'no controller follows the tool: start kinematic_control'
        message = PoseStamped()
        message.header.frame_id = self._base
        message.pose.orientation.w = 1.0
        p = message.pose.position
        p.x, p.y, p.z = (float(x) for x in place)
        self._targets.publish(message)
        return True, f'tool to {p.x:.3f}, {p.y:.3f}, {p.z:.3f} m'

    def _is_heard(self, topic: str) -> bool:
        """Whether a node that moves the arm listens."""
        listeners = self._node.get_subscriptions_info_by_topic(self._node.resolve_topic_name(topic))
        names = [endpoint_name(listener).rpartition('/')[2] for listener in listeners]
        return any(name and name not in _LISTENERS for name in names)
