"""What has to be there before a node moves the arm."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics.topic import Topic
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.ros.graph.sole_publisher import SolePublisher
from aerarm_ros.ros.states.arm_clock import monotonic_ns
from aerarm_ros.ros.states.arm_modes import to_switch_on

# Nobody commands the arm then, and the bridge holds it where it is.
MOVABLE = 'ready'
# What ends a mode in which the arm follows no command.
_ADVICE = {
    'inactive': "activate the bridge: 'ros2 lifecycle set /NAME activate'",
    'disconnected': 'the boards do not answer: see the log of the bridge',
    'aligning': 'the motors will be aligned in a few seconds',
    'homing': 'the joints will be at their index in a few seconds',
    'unhomed': f'run {to_switch_on("unhomed")} (the arm moves)',
    'commissioning': "the arm is being commissioned: wait, then 'arm home'",
    'running': 'another node commands the arm: stop it',
    'damping': "run 'arm hold', which holds the arm where it is",
}
# By then all nodes in the domain have announced themselves (config/fastdds.xml) [s].
_DISCOVERY_TIME = 0.5
_DEPTH = 100  # messages that may wait for this process
_LISTENERS = {
    topics.JOINT_COMMAND.name: 'are the bridge, and the recorder if wanted, running?',
    topics.JOINT_STATES.name: 'is the recorder running?',
}
_ENABLE = "run 'arm enable' (the arm moves)"


def _all_of(topic: Topic) -> QoSProfile:
    return QoSProfile(
        depth=_DEPTH, reliability=topic.qos.reliability, durability=topic.qos.durability
    )


class StartConditions:
    """Follows arm_mode and recorder_status, and says in words what is missing.

    Its callbacks need an executor that spins the node.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    commands
        Publisher of joint_command.
    subscribers
        How many subscribers joint_command and joint_states must have.
    recorder
        Whether the recorder must have found both.
    on_mode
        Called with each arm_mode and when it was published [ns, monotonic].

    Attributes
    ----------
    mode
        Last arm_mode, '' before the first.
    """

    def __init__(
        self,
        node: Node,
        commands: Publisher,
        subscribers: int,
        recorder: bool,
        on_mode: Callable[[str, int], None],
    ) -> None:
        self.mode = ''
        self._discovered = time.monotonic() + _DISCOVERY_TIME
        self._node = node
        self._commands = commands
        self._subscribers = subscribers
        self._recorder = recorder
        self._recorded: set[str] = set()
        self._tell_mode = on_mode
        self._sources = SolePublisher(node, topics.JOINT_STATES)
        for topic, callback in (
            (topics.ARM_MODE, self._on_mode),
            (topics.RECORDER_STATUS, self._on_recorder_status),
        ):
            # Each of the modes counts, however fast they change.
            node.create_subscription(topic.type, topic.name, callback, _all_of(topic))

    def missing(self) -> list[str]:
        """Return what is missing, a phrase each.

        Raises
        ------
        ExcitationError
            If the arm is in fault, which waiting does not mend.
        """
        if self.mode == 'fault':
            raise ExcitationError(
                "arm_mode is fault: see the log of the bridge, then 'arm clear_fault'"
            )
        if not self.mode:
            return ['there is no arm_mode: is a bridge running in this ROS domain?']
        missing = list(filter(None, [self._sources.problem()]))
        if time.monotonic() < self._discovered:
            missing.append('other bridges are being looked for')
        if self.mode != MOVABLE:
            missing.append(f"arm_mode is '{self.mode}': {_ADVICE.get(self.mode, _ENABLE)}")
        matched = {
            topics.JOINT_COMMAND.name: self._commands.get_subscription_count(),
            topics.JOINT_STATES.name: self._node.count_subscribers(topics.JOINT_STATES.name),
        }
        for name, count in matched.items():
            if count < self._subscribers:
                missing.append(
                    f'{name} has {count} of {self._subscribers} subscribers: {_LISTENERS[name]}'
                )
        resolve = self._node.resolve_topic_name
        unrecorded = [name for name in matched if resolve(name) not in self._recorded]
        if self._recorder and unrecorded:
            missing.append(
                f"{' and '.join(unrecorded)} not being recorded: run 'recorder' in this ROS domain"
            )
        return missing

    def _on_mode(self, message: String, info: Mapping[str, int]) -> None:
        self.mode = message.data
        self._tell_mode(message.data, monotonic_ns(info['source_timestamp']))

    def _on_recorder_status(self, message: String) -> None:
        try:
            status = json.loads(message.data)
            recording = status['state'] == 'recording'
            self._recorded = set(status['matched']) if recording else set()
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            self._node.get_logger().warning(f'recorder_status is not understood: {error}')
