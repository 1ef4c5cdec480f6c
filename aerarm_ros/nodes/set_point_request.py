"""Sending the arm to a posture, and seeing it arrive."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.nodes.arm_client import ArmClientError
from aerarm_ros.nodes.endpoint_name import endpoint_name
from aerarm_ros.nodes.spinning import spin_until

_HELD = ('ready', 'running')
_LISTENER = 'recorder'  # hears everything, and moves nothing


def go_to_posture(node: Node, posture: Sequence[float], tolerance: float, timeout: float) -> None:
    """Publish a set point and wait until the arm is there.

    Parameters
    ----------
    node
        Publishes and listens; no executor may hold it.
    posture
        Joint angles in the order of `joint_states` [rad].
    tolerance
        How near every joint must come [rad].
    timeout
        Longest time for a controller to be found, and again for the way [s].

    Raises
    ------
    ArmClientError
        If no arm or controller is there, the posture is of another arm, or it is not reached.
    """
    states: list[JointState] = []
    modes: list[str] = []

    def keep_state(message: JointState) -> None:
        states[:] = [message]

    def keep_mode(message: String) -> None:
        modes[:] = [message.data]

    topic = topics.SET_POINT
    publisher = node.create_publisher(topic.type, topic.name, topic.qos)
    topic = topics.JOINT_STATES
    subscriptions = [node.create_subscription(topic.type, topic.name, keep_state, topic.qos)]
    topic = topics.ARM_MODE
    subscriptions.append(node.create_subscription(topic.type, topic.name, keep_mode, topic.qos))
    try:
        if not spin_until(node, lambda: states and modes and _is_heard(node, publisher), timeout):
            there = states and modes
            what = 'no controller takes a set_point' if there else 'there are no joint_states'
            raise ArmClientError(
                f'{what}: do a bridge and computed_torque or gravity_compensation run in this '
                'ROS domain?'
            )
        if modes[0] not in _HELD:
            raise ArmClientError(f'arm_mode is {modes[0]}: arm enable first')
        names = list(states[0].name)
        if len(posture) != len(names):
            raise ArmClientError(f'give {len(names)} angles [rad], of {", ".join(names)}')
        publisher.publish(JointState(name=names, position=list(posture)))

        def distance() -> NDArray[np.float64]:
            error: NDArray[np.float64] = np.abs(np.array(states[0].position) - posture)
            return error

        if not spin_until(node, lambda: np.all(distance() <= tolerance), timeout):
            far = np.argmax(distance())
            raise ArmClientError(
                f'{names[far]} is still {distance()[far]:.3f} rad away after {timeout:g} s: see '
                'arm_mode, and whether the controller rejected the set point'
            )
    finally:
        for subscription in subscriptions:
            node.destroy_subscription(subscription)
        node.destroy_publisher(publisher)


def _is_heard(node: Node, publisher: Publisher) -> bool:
    """Tell whether a controller listens, and everybody who does is connected."""
    listeners = node.get_subscriptions_info_by_topic(publisher.topic_name)
    names = [endpoint_name(listener) for listener in listeners]
    if not all(names) or all(name.rpartition('/')[2] == _LISTENER for name in names):
        return False
    return bool(publisher.get_subscription_count() >= len(listeners))
