"""Sending the tool to a place, and seeing it arrive."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.ros.executors.spinning import spin_until, this_domain
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.rejection_watch import RejectionWatch
from aerarm_ros.ros.states.arm_modes import HELD, to_switch_on


class ToolRequest:
    """Publishes a tool target, and listens to where the tool goes.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may hold it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._pose: PoseStamped | None = None
        self._mode = ''
        self._rejections = RejectionWatch(node)
        topic = topics.TOOL_TRAJECTORY
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        for heard, callback in (
            (topics.TOOL_POSE, self._on_pose),
            (topics.ARM_MODE, self._on_mode),
        ):
            node.create_subscription(heard.type, heard.name, callback, heard.qos)

    def go(
        self,
        place: Sequence[float],
        tolerance: float,
        timeout: float,
        on_wait: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Send the tool to a place and wait until it is there.

        Parameters
        ----------
        place
            (3,) [m] in the arm's base.
        tolerance
            How near it must come [m].
        timeout
            Longest time for a controller to be found, and again for the way [s].
        on_wait
            Told what is waited for.

        Raises
        ------
        ArmClientError
            If no Cartesian controller runs, the arm is not held, or the place is rejected or not
            reached.
        """
        self._find(timeout, on_wait)
        assert self._pose is not None
        self._rejections.begin(timeout)
        message = PoseStamped(header=self._pose.header)
        p = message.pose.position
        p.x, p.y, p.z = (float(x) for x in place)
        message.pose.orientation.w = 1.0
        self._publisher.publish(message)

        def distance() -> float:
            assert self._pose is not None
            p = self._pose.pose.position
            return float(np.linalg.norm(np.array([p.x, p.y, p.z]) - np.asarray(place)))

        def ended() -> bool:
            return distance() <= tolerance or bool(self._rejections.reason())

        in_time = spin_until(self._node, ended, timeout)
        if self._rejections.reason():
            raise ArmClientError(f'rejected: {self._rejections.reason()}')
        if not in_time:
            raise ArmClientError(
                f'the tool is still {distance():.3f} m away after {timeout:g} s; arm_mode is '
                f'{self._mode}'
            )

    def _find(self, timeout: float, on_wait: Callable[[str], None]) -> None:
        """Wait until a controller tells where the tool is, and takes a target."""

        def is_there() -> bool:
            told = self._pose is not None and bool(self._mode)
            return told and self._publisher.get_subscription_count() > 0

        what = f'kinematic_control or impedance_control in {this_domain()}'
        if not spin_until(self._node, is_there, min(timeout, 1.0)):
            on_wait(what)
            if not spin_until(self._node, is_there, timeout):
                raise ArmClientError(f'no controller tells of the tool: run a bridge, and {what}')
        if self._mode not in HELD:
            raise ArmClientError(f'arm_mode is {self._mode}: run {to_switch_on(self._mode)} first')

    def _on_pose(self, message: PoseStamped) -> None:
        self._pose = message

    def _on_mode(self, message: String) -> None:
        self._mode = message.data
