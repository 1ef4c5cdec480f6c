"""The emulated arm, enabled, and controllers as processes, for tests over real DDS."""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from own_domain import others_in
from quick_spinning import answer_of, spin_once
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import NodeProcess

NAMES = ['joint1', 'joint2', 'joint3', 'joint4']
LIMIT = 120.0  # [s] longest wait; on a busy machine the arm has a fraction of it


_PAUSE = 0.01  # [s]; receiving each of a thousand states per second takes a core


class ControllerBench:
    """The emulated arm, enabled, and a node that subscribes to its topics."""

    def __init__(self, folder: Path, node: Node, **arm: object) -> None:
        self.folder = folder
        self.node = node
        self.mode = ''
        self.q = np.full(4, np.nan)
        self.dq = np.full(4, np.nan)
        self.heard: dict[str, object] = {}
        self.problems: list[str] = []
        self.answers: list[str] = []
        self.listen(topics.ARM_MODE, lambda m: setattr(self, 'mode', m.data))
        self.listen(topics.JOINT_STATES, self._on_state)
        self.listen(topics.DIAGNOSTICS, self._on_diagnostics)
        log = folder / 'fake_hardware.log'
        arm = {
            'seed': -1,
            'pace': 'lockstep',
            'realtime_priority': 80,
            'encoders': 'absolute',
            **arm,
        }
        self.hardware = NodeProcess('fake_hardware', (), arm, None, log)

    def start(self) -> None:
        self.wait(lambda: self.mode == 'idle', 'the bridge')
        # On a busy machine the bridge may reject a request that its cycle did not serve in 1 s.
        # A running controller may send commands before this process receives `ready`.
        self.wait(
            lambda: self.mode in ('ready', 'running'), 'the alignment', lambda: self.call('enable')
        )

    def call(self, action: str) -> None:
        """Send a request to the bridge; a failed wait reports the answer."""
        client = self.node.create_client(Trigger, f'fake_hardware/{action}')
        assert client.wait_for_service(LIMIT)
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda f: self.answers.append(f'{action}: {f.result().message}'))

    def listen(self, topic: topics.Topic, act: Callable) -> None:
        self.node.create_subscription(topic.type, topic.name, act, topic.qos)

    def keep(self, topic: topics.Topic) -> None:
        self.listen(topic, lambda m: self.heard.__setitem__(topic.name, m))

    def publisher(self, topic: topics.Topic):
        publisher = self.node.create_publisher(topic.type, topic.name, topic.qos)
        self.wait(lambda: publisher.get_subscription_count() > 0, topic.name)
        return publisher

    def controller(self, name: str, **parameters: object) -> NodeProcess:
        parameters = {'realtime_priority': 70, **parameters}
        return NodeProcess(name, (), parameters, None, self.folder / f'{name}.log')

    def wait(
        self,
        condition: Callable[[], bool],
        what: str,
        again: Callable | None = None,
        every: float = 4.0,
    ) -> None:
        """Wait; call `again` at first and every `every` [s], as a user would retry."""
        deadline = time.monotonic() + LIMIT
        repeat = 0.0
        while not condition():
            if again is not None and time.monotonic() > repeat:
                repeat = time.monotonic() + every
                again()
            spin_once(self.node, 0.05)
            time.sleep(_PAUSE)
            late = time.monotonic() > deadline
            assert not late, (
                f'waited for {what}: {self.mode} {self.q} {self.answers[-3:]} '
                f'{others_in(os.environ["ROS_DOMAIN_ID"])}'
            )
            assert self.hardware.returncode is None, self.hardware.tail()

    def wait_for_posture(self, q: list[float], tolerance: float, again: Callable) -> None:
        self.wait(
            lambda: np.abs(self.q - q).max() < tolerance and np.abs(self.dq).max() < 0.05,
            f'{q}',
            again,
        )

    def set_parameter(self, name: str, parameter: str, value: object) -> None:
        client = self.node.create_client(SetParameters, f'{name}/set_parameters')
        assert client.wait_for_service(LIMIT)
        request = SetParameters.Request(
            parameters=[Parameter(parameter, value=value).to_parameter_msg()]
        )
        (result,) = answer_of(self.node, lambda: client.call_async(request), LIMIT).results
        assert result.successful, result.reason

    def parameter(self, name: str, parameter: str) -> str:
        client = self.node.create_client(GetParameters, f'{name}/get_parameters')
        assert client.wait_for_service(LIMIT)
        request = GetParameters.Request(names=[parameter])
        (value,) = answer_of(self.node, lambda: client.call_async(request), LIMIT).values
        return value.string_value

    def _on_state(self, message: JointState) -> None:
        self.q, self.dq = np.array(message.position), np.array(message.velocity)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.problems += [status.message for status in message.status]


def trajectory(q: list[float], seconds: float, names: list[str] = NAMES) -> JointTrajectory:
    whole, part = divmod(seconds, 1.0)
    time_from_start = Duration(sec=int(whole), nanosec=int(part * 1e9))
    point = JointTrajectoryPoint(positions=q, time_from_start=time_from_start)
    return JointTrajectory(joint_names=names, points=[point])
