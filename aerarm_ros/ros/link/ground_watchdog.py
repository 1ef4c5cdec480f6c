"""Reaction of the drone to the loss of the ground computer."""

from __future__ import annotations

from math import inf
from types import SimpleNamespace

from rclpy.node import Node
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from aerarm_msgs_py import topics
from aerarm_msgs_py.topics import Topic
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.ros.graph import endpoint_name

CONTINUE, STOP, HOME = 'continue', 'stop', 'home'


class GroundWatchdog:
    """Stop the motion, or move the arm home, after `ground_timeout` without ground datagrams.

    Each action is one message on one topic, because a controller may process messages of two topics
    in any order. A controller that receives a set point during a motion first stops on its path.

    Parameters
    ----------
    node
        Owner of the publishers.
    values
        `ground_timeout` [s], 0 to do nothing; `ground_lost`; `config` and `tf_prefix` of the arm.

    Attributes
    ----------
    problem
        Description of the last action; empty while the ground computer is connected.
    """

    def __init__(self, node: Node, values: SimpleNamespace) -> None:
        self.problem = ''
        self._node = node
        self._timeout, self._action = values.ground_timeout, values.ground_lost
        config = load_arm_config(values.config or None)
        self._home = JointState(
            name=[f'{values.tf_prefix}{name}' for name in config.joint_names],
            position=[float(angle) for angle in config.rest_position],
        )
        self._topic: Topic = topics.SET_POINT if self._action == HOME else topics.JOINT_TRAJECTORY
        self._requests = node.create_publisher(
            self._topic.type, self._topic.name, self._topic.offered
        )

    @property
    def text(self) -> str:
        """Description of the watchdog's action."""
        if not self._timeout:
            return CONTINUE
        return f'{self._action} after {self._timeout:g} s'

    def update(self, now: float, last_received: float) -> None:
        """Act once per loss of connection, but not before the ground computer's first message."""
        is_lost = 0.0 < self._timeout < now - last_received < inf
        if not is_lost:
            self.problem = ''
        elif not self.problem:
            self.problem = f'the ground is silent: {self._act()}'
            self._node.get_logger().warning(self.problem)

    def warning(self) -> str:
        """Return which controller would ignore the watchdog's request, or an empty text."""
        names = self._ignorant()
        if not names:
            return ''
        return (
            f"ground_lost is '{self._action}', but {names} does not subscribe to "
            f'{self._topic.name}: run computed_torque or gravity_compensation, or set '
            f'ground_lost:={CONTINUE}'
        )

    def _act(self) -> str:
        if self._action == CONTINUE:
            return 'the motion continues'
        self._requests.publish(self._home if self._action == HOME else JointTrajectory())
        names = self._ignorant()
        if names:
            return f'the motion continues, because {names} does not subscribe to {self._topic.name}'
        if self._action == HOME:
            return 'the arm returns to its home configuration'
        return 'the motion stops along its path'

    def _ignorant(self) -> str:
        """Return the nodes that command the arm and do not receive the watchdog's request."""
        if not self._timeout or self._action == CONTINUE:
            return ''
        commands = self._node.resolve_topic_name(topics.JOINT_COMMAND.name)
        requests = self._node.resolve_topic_name(self._topic.name)
        controllers = map(endpoint_name, self._node.get_publishers_info_by_topic(commands))
        receivers = map(endpoint_name, self._node.get_subscriptions_info_by_topic(requests))
        return ' and '.join(sorted({*controllers} - {*receivers, ''}))
