"""The bridge between the boards and ROS: one exchange with every board per millisecond."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.hardware.answer import Answer
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.transport import Transport
from aerarm_ros.nodes.background_executor import BackgroundExecutor
from aerarm_ros.nodes.bridge_diagnostics import BridgeDiagnostics
from aerarm_ros.nodes.bridge_parameters import BRIDGE_PARAMETERS, bridge_settings
from aerarm_ros.nodes.bridge_services import BridgeServices
from aerarm_ros.nodes.bridge_streams import BridgeStreams
from aerarm_ros.nodes.node_main import run_node
from aerarm_ros.nodes.parameter import Parameter
from aerarm_ros.nodes.parameters import ParameterTable
from aerarm_ros.nodes.robot_description import RobotDescription
from aerarm_ros.nodes.stop_signals import StopSignals
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.realtime.scheduling import (
    freeze_garbage_collector,
    lock_memory,
    set_affinity,
    set_fifo,
)

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
# Long enough for the last frames of a cycle, short enough for a lifecycle client.
_LOOP_END_TIMEOUT = 2.0
_REQUEST_TIMEOUT = 1.0
# The arm's mode while no cycle runs; the others are `bridge_cycle.MODES`.
INACTIVE = 'inactive'


class HardwareBridge(LifecycleNode):
    """Managed node around a `BridgeCycle`.

    Configuring opens the buses, activating starts the cycle, deactivating leaves the boards
    without current. The cycle runs in the thread that calls `run`, everything else in the
    executor's; the two share nothing but the queue of requests and finished numbers.

    Parameters
    ----------
    name
        Node name.
    parameters
        Parameters of a derived bridge.

    Raises
    ------
    ParameterError
        If a parameter's value can't be used.
    """

    def __init__(self, name: str = 'hardware_bridge', parameters: Sequence[Parameter] = ()) -> None:
        super().__init__(name)
        self.values = ParameterTable(*BRIDGE_PARAMETERS, *parameters).declare(self)
        self._mode_publisher = self.create_publisher(
            String, topics.ARM_MODE.name, topics.ARM_MODE.qos
        )
        BridgeServices(self, self.request)
        self._diagnostics = BridgeDiagnostics(self)
        self._requests: deque[tuple[Callable[[BridgeCycle], Answer], Future[Answer]]] = deque()
        self._work = threading.Event()
        self._loop: PeriodicLoop | None = None
        self._loop_ended = threading.Event()
        self._loop_ended.set()
        self._stopping = False
        self.status = 0  # exit status for run_node
        self._mode = ''
        self._problem = ''
        self._stamp_ns = 0

    # What a derived bridge changes.

    def make_transport(self, config: ArmConfig, robot: Robot) -> Transport:
        """Return the way to the boards; raises ValueError or OSError with what to check."""
        from aerarm_ros.hardware.spidev_transport import SpidevTransport

        return SpidevTransport(config)

    # Lifecycle, in the executor's thread.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the configuration and open the buses."""
        try:
            config = load_arm_config(self.values.config or None)
            robot = load_robot(self.values.urdf or None, gravity_in_base=config.gravity_in_base)
            self._transport = self.make_transport(config, robot)
            self._transport.open()
        except (ValueError, OSError) as error:
            self._problem = f'not configured: {error}'
            self.get_logger().error(self._problem)
            return FAILURE
        self._cycle = BridgeCycle(
            config,
            self._transport,
            bridge_settings(self.values),
            allowed_sources=self.values.allowed_publishers,
        )
        self._streams = BridgeStreams(self, config.joint_names)
        self._description = RobotDescription(self, robot.urdf_text)
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the cycle; the motors stay off until the enable service is called."""
        self._loop = PeriodicLoop(self.values.period)
        self._diagnostics.watch(self._cycle, self._loop)
        self._loop_ended.clear()
        self._work.set()
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the cycle and switch the motors off."""
        if self._loop is not None:
            self._loop.stop()
        return SUCCESS if self._loop_ended.wait(_LOOP_END_TIMEOUT) else FAILURE

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the buses."""
        self._diagnostics.watch(None, None)
        self._streams.destroy()
        self._description.destroy()
        self._transport.close()
        self._loop = None
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop for good."""
        self.stop()
        return SUCCESS

    # The cycle, in the main thread.

    def run(self) -> None:
        """Run until SIGINT, SIGTERM or `stop`; raises OSError if it can't start by itself."""
        with StopSignals(self.stop), BackgroundExecutor(self):
            if self.values.autostart and not self._start():
                raise OSError(self._problem)
            self._prepare_thread()
            self._run_while_active()
        print(f'{self.get_name()}: {self._diagnostics.account()}', flush=True)

    def close(self) -> None:
        """Destroy the node."""
        self.destroy_node()

    def _start(self) -> bool:
        return self.trigger_configure() == SUCCESS and self.trigger_activate() == SUCCESS

    def _run_while_active(self) -> None:
        while not self._stopping:
            self._work.wait()
            self._work.clear()
            if self._loop is None or self._stopping:
                continue
            try:
                self._loop.run(self._run_cycle)
            finally:
                # Whatever ended the loop, an exception included, the motors go off.
                self._cycle.shutdown()
                self._publish_mode(INACTIVE)
                self._loop_ended.set()

    def stop(self) -> None:
        """End `run` after the present cycle; may be called from any thread or signal handler."""
        self._stopping = True
        if self._loop is not None:
            self._loop.stop()
        self._work.set()

    def request(self, action: Callable[[BridgeCycle], Answer]) -> Answer:
        """Let the cycle's thread do something between two cycles and return its answer.

        Raises
        ------
        RuntimeError
            If the bridge isn't active.
        """
        if self._loop_ended.is_set():
            raise RuntimeError('the bridge is not active: activate it first (ros2 lifecycle set)')
        answer: Future[Answer] = Future()
        self._requests.append((action, answer))
        return answer.result(_REQUEST_TIMEOUT)

    def _prepare_thread(self) -> None:
        """Ask for what real time needs; a refusal is a warning, the arm still runs."""
        values = self.values
        warnings = [
            set_affinity(values.cpus) if values.cpus else None,
            set_fifo(values.realtime_priority) if values.realtime_priority else None,
            lock_memory() if values.lock_memory else None,
            freeze_garbage_collector() if values.freeze_gc else None,
        ]
        for warning in filter(None, warnings):
            self.get_logger().warning(warning)

    def _run_cycle(self, now_ns: int, index: int) -> None:
        cycle, now = self._cycle, now_ns * 1e-9
        while self._requests:
            action, answer = self._requests.popleft()
            answer.set_result(action(cycle))
        command = self._streams.newest_command()
        if command is not None:
            names, sample = command
            age_ns = time.time_ns() - sample.stamp_ns
            numbers = (sample.position, sample.velocity, sample.effort)
            cycle.command(names, *numbers, age_ns * 1e-9, now, 'joint_command')
            self._diagnostics.add_command(age_ns, sample.stamp_ns == self._stamp_ns)
        cycle.update(now)
        self._stamp_ns = time.time_ns()
        self._streams.publish(
            self._stamp_ns,
            (cycle.q, cycle.dq, cycle.tau),
            (cycle.motor_position, cycle.motor_velocity, cycle.motor_current),
            cycle.motor_power,
        )
        if cycle.mode != self._mode:
            self._publish_mode(cycle.mode)

    def _publish_mode(self, mode: str) -> None:
        self._mode = mode
        self._mode_publisher.publish(String(data=mode))


def main(args: Sequence[str] | None = None) -> int:
    """Run the bridge on the SPI boards."""
    return run_node('hardware_bridge', HardwareBridge, args)


if __name__ == '__main__':
    sys.exit(main())
