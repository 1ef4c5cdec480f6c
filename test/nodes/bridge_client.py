"""A controller and a user in one, which drives a bridge process from a test over real DDS."""

import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from quick_spinning import spin_once, spin_until
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_modes import HELD, OFF
from aerarm_ros.ros.process.node_process import NodeProcess

StartBridge = Callable[..., NodeProcess]  # from fixture start_bridge
SERVICES = ('enable', 'disable', 'clear_fault', 'home', 'e_stop', 'inject_fault', 'put_back')
_PAUSE = 4e-3  # [s]; receiving each of a thousand states per second takes a core
# Receive every mode, even if this process is delayed.
_ALL = QoSProfile(
    depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
JOINTS = ['joint1', 'joint2', 'joint3', 'joint4']


class BridgeClient:
    """Subscribe to all of a bridge's topics; answer every state while `answer` is set."""

    def __init__(self, node: Node, bridge: str = 'fake_hardware') -> None:
        self._node = node
        self.states: list[JointState] = []
        self.motors: list[JointState] = []
        self.powers: list[Float64MultiArray] = []
        self.modes: list[str] = []
        # Empty until the first message.
        self.diagnostics: dict[str, dict[str, str]] = defaultdict(dict)
        self.messages: dict[str, str] = defaultdict(str)
        self.diagnosed = 0.0  # stamp of the newest diagnostics [s]
        self.answer: Callable[[JointState], JointState | None] | None = None
        self.commands = self._publisher()
        self._parameters = AsyncParameterClient(node, bridge)
        # Created early: an answer is lost if the bridge has not yet discovered the client.
        self._services = {
            name: node.create_client(Trigger, f'{bridge}/{name}') for name in SERVICES
        }
        for topic, store in (
            (topics.JOINT_STATES, self._on_state),
            (topics.MOTOR_STATES, self.motors.append),
            (topics.MOTOR_POWER, self.powers.append),
            (topics.ARM_MODE, lambda message: self.modes.append(message.data)),
            (topics.DIAGNOSTICS, self._on_diagnostics),
        ):
            qos = _ALL if topic is topics.ARM_MODE else topic.qos
            node.create_subscription(topic.type, topic.name, store, qos)

    def call(self, service: str) -> Trigger.Response:
        client = self._services[service]
        assert client.wait_for_service(60.0), service
        return self._wait_answer(client.call_async(Trigger.Request()))

    def set_parameters(self, **values: object) -> list[str]:
        """Set parameters of the bridge; return the reasons of rejected ones."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        answer = self._wait_answer(self._parameters.set_parameters(parameters))
        return [result.reason for result in answer.results if not result.successful]

    def get_parameters(self, *names: str) -> list[object]:
        """Return values of parameters of the bridge."""
        answer = self._wait_answer(self._parameters.get_parameters(list(names)))
        return [parameter_value_to_python(value) for value in answer.values]

    def _wait_answer(self, future: Future) -> Any:
        assert spin_until(self._node, future.done, 60.0), 'no answer'
        return future.result()

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._spin_once()

    def wait_for(self, condition: Callable[[], bool], timeout: float = 120.0) -> None:
        """Wait for a condition; on a busy machine the arm's time is a fraction of the host's."""
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, (self.modes, self.messages)
            self._spin_once()

    def wait_for_mode(self, mode: str) -> None:
        self.wait_for(lambda: bool(self.modes) and self.modes[-1] == mode)

    def make_ready(self) -> None:
        """Enable the arm, or home it if its zeros are unknown."""
        self.wait_for(lambda: self.modes[-1:] and self.modes[-1] in OFF)
        assert self.call('enable' if self.modes[-1] == 'idle' else 'home').success
        # A controller that answers at once may change the mode before this process receives it.
        self.wait_for(lambda: self.modes[-1] in HELD and bool(self.states))

    def _spin_once(self) -> None:
        spin_once(self._node, 0.01)
        if self.answer is None:
            time.sleep(_PAUSE)  # no code waits for it

    def _publisher(self) -> Publisher:
        topic = topics.JOINT_COMMAND
        return self._node.create_publisher(topic.type, topic.name, topic.qos)

    def _on_state(self, state: JointState) -> None:
        self.states.append(state)
        command = self.answer(state) if self.answer else None
        if command is not None:
            self.commands.publish(command)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            part = status.name.rsplit(' ', 1)[-1]
            if part == 'timing':  # not every message has it
                self.diagnosed = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            self.diagnostics[part] = {item.key: item.value for item in status.values}
            self.messages[part] = status.message


def velocity_command(state: JointState, velocity: list[float]) -> JointState:
    command = JointState(name=JOINTS, velocity=velocity)
    command.header.stamp = state.header.stamp
    return command
