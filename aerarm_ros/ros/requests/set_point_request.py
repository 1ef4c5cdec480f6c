"""Sending the arm to a posture, and seeing it arrive."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.ros.executors.spinning import spin_until, this_domain
from aerarm_ros.ros.graph.endpoint_name import endpoint_name
from aerarm_ros.ros.requests.arm_client import ArmClientError
from aerarm_ros.ros.requests.rejection_watch import RejectionWatch
from aerarm_ros.ros.states.arm_modes import HELD, to_switch_on

_LISTENER = 'recorder'  # hears everything, and moves nothing
_SEARCH = 10.0  # [s] that a busy machine may take to bring processes together


class SetPointRequest:
    """Publishes a set point, and listens to what becomes of it.

    Parameters
    ----------
    node
        Owner of publisher and subscriptions; no executor may hold it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._state: JointState | None = None
        self._mode = ''
        self._rejections = RejectionWatch(node)
        topic = topics.SET_POINT
        self._publisher = node.create_publisher(topic.type, topic.name, topic.offered)
        self._listen(topics.JOINT_STATES, self._on_state)
        self._listen(topics.ARM_MODE, self._on_mode)

    def go(
        self,
        posture: Sequence[float],
        tolerance: float,
        timeout: float,
        on_wait: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Send the arm to a posture and wait until it is there.

        Parameters
        ----------
        posture
            Joint angles in the order of `joint_states` [rad].
        tolerance
            How near every joint must come [rad].
        timeout
            Longest time for a controller to be found once the arm is there, and again for the
            way [s].
        on_wait
            Told what is waited for.

        Raises
        ------
        ArmClientError
            If no arm or controller is there, the posture is of another arm or rejected, or it is
            not reached.
        """
        names = self._find_arm(timeout, on_wait)
        if len(posture) != len(names):
            raise ArmClientError(f'give {len(names)} angles [rad], of {", ".join(names)}')
        self._rejections.begin(timeout)
        self._publisher.publish(JointState(name=names, position=list(posture)))

        def distance() -> NDArray[np.float64]:
            assert self._state is not None
            error: NDArray[np.float64] = np.abs(np.array(self._state.position) - posture)
            return error

        def ended() -> bool:
            return bool(np.all(distance() <= tolerance) or self._rejections.reason())

        in_time = spin_until(self._node, ended, timeout)
        if self._rejections.reason():
            raise ArmClientError(f'rejected: {self._rejections.reason()}')
        if not in_time:
            far = np.argmax(distance())
            raise ArmClientError(
                f'{names[far]} is still {distance()[far]:.3f} rad away after {timeout:g} s; '
                f'arm_mode is {self._mode}'
            )

    def _find_arm(self, timeout: float, on_wait: Callable[[str], None]) -> list[str]:
        """Return the joints' names once arm and controller are there."""

        def is_there() -> bool:
            return self._state is not None and bool(self._mode)

        what = ''
        if not spin_until(self._node, is_there, 1.0):
            on_wait(f'joint_states and arm_mode in {this_domain()}')
        if not spin_until(self._node, is_there, max(timeout, _SEARCH)):
            what = 'there are no joint_states'
        elif not spin_until(self._node, self._is_heard, timeout):
            what = 'no controller takes a set_point'
        if what:
            raise ArmClientError(
                f'{what}: do a bridge and computed_torque or gravity_compensation run in '
                f'{this_domain()}?'
            )
        if self._mode not in HELD:
            raise ArmClientError(f'arm_mode is {self._mode}: run {to_switch_on(self._mode)} first')
        assert self._state is not None
        return list(self._state.name)

    def _is_heard(self) -> bool:
        """Tell whether a controller listens, and everybody who does is connected."""
        listeners = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
        names = [endpoint_name(listener) for listener in listeners]
        if not all(names) or all(name.rpartition('/')[2] == _LISTENER for name in names):
            return False
        return bool(self._publisher.get_subscription_count() >= len(listeners))

    def _listen(self, topic: Topic, callback: Callable[..., None]) -> None:
        self._node.create_subscription(topic.type, topic.name, callback, topic.qos)

    def _on_state(self, message: JointState) -> None:
        self._state = message

    def _on_mode(self, message: String) -> None:
        self._mode = message.data
