"""Node of the bridge, which connects the motor boards with ROS at 1 kHz."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import ChangeState
from numpy.typing import ArrayLike
from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.cdr import Float64ArrayCdr
from aerarm_msgs_py.codecs.joint_state_cdr import JointSample, JointStateCdr, decode_as_sent
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.boards.kept_zeros import KeptZeros, ZeroFile
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import ACTIONS, Action, Answer
from aerarm_ros.hardware.frames.frame_profile import FrameProfile, load_profile
from aerarm_ros.hardware.gate.command_intake import CommandPublishers, OfferedCommand
from aerarm_ros.motion.signals import Array
from aerarm_ros.realtime.periodic_loop import CycleSlack, PeriodicLoop, SteadyClock
from aerarm_ros.ros.bridge.bridge_diagnostics import (
    BridgeDiagnostics,
    BridgeTiming,
    ModeLog,
    RejectionLog,
    Status,
    followed_by,
)
from aerarm_ros.ros.bridge.bridge_parameters import (
    BRIDGE_PARAMETERS,
    board_gains,
    bridge_settings,
    make_transport,
    state_file,
)
from aerarm_ros.ros.bridge.bridge_services import BridgeServices, CycleRequests
from aerarm_ros.ros.bridge.commissioning_topics import CommissioningTopics, RecordWatch
from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.graph import DuplicatePublisherWatch, PublisherWatch
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.parameters.shared_parameters import load_arm, load_drone, prepare_thread
from aerarm_ros.ros.process.process_end import StopSignals, print_answer
from aerarm_ros.ros.process.shared_ports import PortWatch

if TYPE_CHECKING:  # for type checkers only
    from aerarm_ros.hardware.boards.board_link import Transport


def answer_invalid_transitions(node: LifecycleNode) -> None:
    """Patch a managed node so that it answers requests for invalid lifecycle transitions.

    rclpy (7.1) raises an exception instead, so the client never receives an answer. The patched
    node rejects the request and logs the valid transitions.
    """
    service = node._service_change_state
    change = service.callback

    def handle(request: ChangeState.Request, response: ChangeState.Response) -> object:
        try:
            return change(request, response)
        except RCLError:
            machine = node._state_machine
            _, state = machine.current_state
            labels = [label for _, label, *_ in machine.available_transitions]
            wanted = request.transition.label or f'number {request.transition.id}'
            node.get_logger().warning(
                f'lifecycle transition {wanted} is impossible in state {state}: choose one of '
                f'{", ".join(labels)}'
            )
            response.success = False
            return response

    service.callback = handle


SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
# [s] Long enough for the last frames of a cycle, short enough for a lifecycle client.
_LOOP_END_TIMEOUT = 2.0
# Number of cycles in which boards may be undetected; requests wait during that time.
_UNKNOWN_MAX = 50
# The arm's mode while no cycle runs; `bridge_modes.MODES` lists the others.
INACTIVE = 'inactive'
# Modes in which no motion depends on the stamps of the joint states.
_MOTORS_OFF = (INACTIVE, 'disconnected', 'idle', 'unhomed')
PARAMETERS = ParameterTable(*BRIDGE_PARAMETERS)
_GAINS = {'board_kp', 'board_kd', 'board_ki'}


class World:
    """Boards, clock and loop of a bridge with a real arm.

    The package `aerarm_ros.ros.emulation` derives those of an emulated arm from this class. The
    bridge therefore does not import emulated boards and simulation time.

    Attributes
    ----------
    emulated
        Whether the boards are emulated.
    parameters
        Parameters of the bridge.
    clock
        Clock for the stamps of the joint states.
    live
        Action for each live parameter, by name; the cycle runs it after the parameter has changed.
    """

    emulated = False
    parameters = PARAMETERS
    live: Mapping[str, Action] = {}
    bridge: HardwareBridge

    def __init__(self) -> None:
        self.clock = SteadyClock()

    def load_arm(self) -> tuple[ArmConfig, Robot]:
        """Load configuration and model of the arm, or raise ValueError."""
        return load_arm(self.bridge.values)

    def make_transport(self, config: ArmConfig, robot: Robot, profile: FrameProfile) -> Transport:
        """Return the connection to the boards, or raise ValueError or OSError."""
        if config.emulated_only:
            raise ValueError(
                f'the configuration of {config.name} is for emulated boards only: measure the '
                'values that the file marks as guesses, then remove the line emulated_only'
            )
        return make_transport(self.bridge.values.transport, config)

    def make_loop(self) -> PeriodicLoop:
        """Return the loop that calls the bridge's cycle periodically."""
        return PeriodicLoop(self.bridge.values.period)

    def now_ns(self) -> int:
        """Return the present time for stamps of joint states [ns since the epoch]."""
        return self.clock.now_ns()

    def newest_command(self) -> Command | None:
        """Return the newest joint command since the last call, None if there is none.

        Raises ValueError if the command cannot be decoded.
        """
        return self.bridge.streams.newest_command()

    def end_cycle(self, now: float, stamp_ns: int) -> None:
        """Do nothing; an emulated arm uses this call after each cycle for its simulation."""

    def actions(self) -> Mapping[str, Action]:
        """Return the actions of additional services by service name; none for a real arm."""
        return {}

    def statuses(self) -> Sequence[Status]:
        """Return additional statuses for /diagnostics; none for a real arm."""
        return ()

    def parameter_problem(self, changes: Mapping[str, Any]) -> str:
        """Return why new values of live parameters are invalid, or an empty string."""
        return ''

    def clean_up(self) -> None:
        """Destroy objects that `make_transport` or `make_loop` created; none for a real arm."""


class HardwareBridge(LifecycleNode):
    """Managed (lifecycle) node that runs the bridge's cycle.

    The transition `configure` opens the SPI buses, `activate` starts the cycle, and `deactivate`
    switches the motors off. The cycle runs in the thread that calls `run`, and all other work in
    the executor's thread. The threads share the queue of requests, finished results, parameter
    values and the table of command publishers.

    Parameters
    ----------
    name
        Node name.
    world
        Boards and clock of the arm, by default those of a real arm.

    Raises
    ------
    ParameterError
        If a parameter has an invalid value.
    """

    def __init__(self, name: str = 'hardware_bridge', world: World | None = None) -> None:
        super().__init__(name)
        answer_invalid_transitions(self)
        self.world = world or World()
        self.world.bridge = self
        self.cycle: BridgeCycle | None = None
        self._loop: PeriodicLoop | None = None
        self.timing: BridgeTiming | None = None
        self.requests = CycleRequests()
        self.values = self.world.parameters.declare(
            self, self._on_parameter, self._parameter_problem
        )
        self._mode_publisher = topics.ARM_MODE.publisher(self)
        self._mode_log = ModeLog(self)
        self._rejection_log = RejectionLog(
            self._mode_log.warn, lambda: self.command_publishers.warning
        )
        self._diagnostics = BridgeDiagnostics(self, self.world.now_ns)
        self._work = threading.Event()
        self._stopping = False
        self._starting = False  # without a lifecycle client a problem ends the process
        self.status = 0  # exit status
        self.mode = ''
        self._problem = ''
        self._stamp_ns = 0
        self._slack = CycleSlack()

    # Lifecycle, in the executor's thread.

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the arm's configuration, open the SPI buses and test the connections."""
        try:
            config, robot = self.world.load_arm()
            drone = load_drone(self.values, config, robot)
            urdf = robot.urdf_text
            if drone is not None:
                from aerarm_ros.description.drone_urdf import with_drone

                urdf = with_drone(urdf, drone, robot.prefix)
            profile = load_profile(self.values.profile or config.profile)
            self.config = config
            self._diagnostics.name_arm(config.name)
            self._transport = self.world.make_transport(config, robot, profile)
            self._transport.open()
            kept_in = state_file(self.values, self.get_fully_qualified_name(), self.world.emulated)
            self.zero_file = ZeroFile(kept_in, config)
            kept = self.zero_file.read(time.monotonic())
            self.record = RecordWatch(self, self.values, config, self.world.emulated)
            self.cycle = BridgeCycle(
                config,
                self._transport,
                bridge_settings(self.values),
                profile,
                robot=robot,
                kept=kept,
                pulse_offset=self.record.pulse_offset,
            )
            if isinstance(kept, KeptZeros) and kept.heat:
                self.cycle.heat.recall(kept.heat, time.monotonic())
            self.cycle.references.check_gains(*self._gains())
        except Exception as error:  # rclpy would drop it without a message
            kind = '' if isinstance(error, ValueError | OSError) else f'{type(error).__name__}: '
            self._problem = f'not configured: {kind}{error}'
            self._discard()
            if not self._starting:
                self.get_logger().error(self._problem)
            return FAILURE
        for text in self.cycle.heat.unknown:
            self.get_logger().warning(text)
        self._try_wires(profile)
        self._commissioning = CommissioningTopics(self, self.requests.ask, self.record)
        self.command_publishers = CommandPublishers(self.values.allowed_publishers)
        self.streams = BridgeStreams(self, config.joint_names)
        self.publisher_watch = PublisherWatch(
            self, topics.JOINT_COMMAND, self.command_publishers.look
        )
        self.duplicates = DuplicatePublisherWatch(self, topics.JOINT_STATES)
        self._description = topics.ROBOT_DESCRIPTION.publisher(self)
        self._description.publish(String(data=urdf))  # latched for later subscribers
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the cycle; the motors stay off until a client calls the service `enable`."""
        assert self.cycle is not None
        self._set_gains(self.cycle)
        self._loop = self.world.make_loop()
        self.timing = BridgeTiming(self._loop, self.world.clock)
        self._diagnostics.watch(self)
        self.requests.open()
        self._work.set()
        return SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the cycle and switch the motors off."""
        if self._loop is not None:
            self._loop.stop()
        if not self.requests.wait_closed(_LOOP_END_TIMEOUT):
            return FAILURE
        self._diagnostics.unwatch()
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the SPI buses."""
        self.world.clean_up()
        self._commissioning.destroy()
        self.publisher_watch.destroy()
        self.duplicates.destroy()
        self.streams.destroy()
        self.destroy_publisher(self._description)
        self._transport.close()
        self.zero_file.close()
        self.cycle = self._loop = None
        return SUCCESS

    def _discard(self) -> None:
        """Release what a failed configuration has opened."""
        self.world.clean_up()
        for name in ('_transport', 'zero_file'):
            opened = self.__dict__.pop(name, None)
            if opened is not None:
                opened.close()
        self.cycle = None

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the cycle and the method `run`."""
        self.stop()
        return SUCCESS

    def _try_wires(self, profile: FrameProfile) -> None:
        """Test the connection to each real board, and log the result."""
        for answer in self._transport.self_test(profile):
            if answer.accepted:
                self.get_logger().info(answer.message)
            else:
                self.get_logger().warning(answer.message)

    def _parameter_problem(self, changes: Mapping[str, Any]) -> str:
        if self.cycle is not None and changes.keys() & _GAINS:
            try:
                self.cycle.references.check_gains(*self._gains(changes))
            except ValueError as error:
                return f'gains of the boards rejected: {error}'
        return self.world.parameter_problem(changes)

    def _on_parameter(self, name: str, value: Any) -> None:
        action = self._set_gains if name in _GAINS else self.world.live.get(name)
        if action is not None:
            self.requests.post(action)

    def _gains(self, changes: Mapping[str, Any] | None = None) -> tuple[ArrayLike, ...]:
        return board_gains({**vars(self.values), **(changes or {})}, self.config)

    def _clear_fault(self, cycle: BridgeCycle) -> Answer:
        answer = cycle.clear_fault()
        if answer.accepted:
            return answer
        # The hint depends on the present joint state, because a damped arm sinks after the fault.
        recovery_hint = f'To recover: {cycle.recovery_hint(self.world.emulated)}'
        return Answer(False, followed_by(answer.message, recovery_hint))

    def _set_gains(self, cycle: BridgeCycle) -> Answer:
        cycle.references.set_gains(*self._gains())
        return Answer(True, 'the gains were set')

    # The cycle, in the main thread.

    def run(self) -> None:
        """Run the bridge until a stop signal or `stop`; raises OSError if autostart fails."""
        with (
            StopSignals(self.stop, stays_awake=True),
            PortWatch(),
            BackgroundExecutor(self, self._slack.wait),
        ):
            if self.values.autostart and not self._start():
                raise OSError(self._problem)
            # A client may call a service as soon as it is visible, so create services after an
            # automatic start.
            actions = {**ACTIONS, 'clear_fault': self._clear_fault, **self.world.actions()}
            BridgeServices(self, self.requests.ask, actions)
            prepare_thread(self.values, self.get_logger())
            self._run_while_active()
        account = self.timing.loop.account() if self.timing else 'no cycle has run yet'
        print_answer(f'{self.get_name()}: {account}')

    def close(self) -> None:
        """Destroy the node."""
        self.destroy_node()

    def _start(self) -> bool:
        self._starting = True
        started = self.trigger_configure() == SUCCESS and self.trigger_activate() == SUCCESS
        self._starting = False
        return bool(started)

    def _run_while_active(self) -> None:
        while not self._stopping:
            self._work.wait()
            self._work.clear()
            if self.requests.is_open:
                self._run_loop()
        self.requests.close()  # `on_activate` may just have opened it again

    def _run_loop(self) -> None:
        loop, cycle, timing = self._loop, self.cycle, self.timing
        assert loop and cycle and timing  # created by activation
        try:
            loop.run(lambda now_ns, index: self._run_cycle(cycle, timing, now_ns * 1e-9))
        finally:
            # The motors go off after any end of the loop, including an exception.
            cycle.shutdown()
            self.zero_file.close()
            self._publish_mode(cycle, INACTIVE)
            self.requests.close()

    def stop(self) -> None:
        """End `run` after the present cycle; callable from any thread or signal handler."""
        self._stopping = True
        if self._loop is not None:
            self._loop.stop()
        self._work.set()

    def _run_cycle(self, cycle: BridgeCycle, timing: BridgeTiming, now: float) -> None:
        if self.requests.are_waiting and self._has_found_boards(cycle):
            self.requests.serve(cycle)
        self._take_command(cycle, timing, now)
        cycle.update(now)
        self._stamp_ns = self.world.now_ns()
        self.streams.publish(
            self._stamp_ns,
            (cycle.q_known, cycle.dq, cycle.tau),
            (cycle.motor_position, cycle.motor_velocity, cycle.motor_current),
            cycle.motor_power,
        )
        if cycle.mode != self.mode:
            self._publish_mode(cycle, cycle.mode)
        self._rejection_log.update(cycle.intake, cycle.mode, now)
        self.zero_file.update(cycle, now)
        self.world.end_cycle(now, self._stamp_ns)
        self.report()
        self._slack.begin()

    def _has_found_boards(self, cycle: BridgeCycle) -> bool:
        """Return whether every board has answered or timed out; requests wait until then."""
        needed = self.values.connect_frames + self.values.bad_frames_max
        return cycle.mode != 'disconnected' or cycle.cycles > min(needed, _UNKNOWN_MAX)

    def report(self) -> None:
        """Check for duplicate publishers and build a part of the diagnostics, once per cycle."""
        self.publisher_watch.poll()
        self.duplicates.poll()
        if self.cycle is not None and (news := self.cycle.heat.news):
            self._mode_log.warn(news.pop(0))
        # Diagnostics are published once per second of real time, also in a slow simulation.
        self._diagnostics.step(time.monotonic())

    def _take_command(self, cycle: BridgeCycle, timing: BridgeTiming, now: float) -> None:
        try:
            command = self.world.newest_command()
        except ValueError:
            cycle.intake.reject('unreadable', now)
            return
        if command is None:
            return
        names, sample, publisher = command
        age_ns = self.world.now_ns() - sample.stamp_ns
        allowed = self.command_publishers.may_command(publisher)
        if not self.command_publishers.knows(publisher):
            self.publisher_watch.look_soon()
        numbers = (sample.position, sample.velocity, sample.effort)
        offered = OfferedCommand(names, *numbers, age_ns * 1e-9, publisher, allowed)
        cycle.command(offered, now)
        timing.add_command(age_ns, sample.stamp_ns == self._stamp_ns)

    def _publish_mode(self, cycle: BridgeCycle, mode: str) -> None:
        self.mode = mode
        self.world.clock.may_step = mode in _MOTORS_OFF
        self._mode_publisher.publish(String(data=mode))
        self._mode_log.note(mode, cycle.faults, cycle.recovery_hint(self.world.emulated))
        self._diagnostics.publish_soon()


# Joint names and content of a joint command, and the publisher's GID.
Command = tuple[Sequence[str], JointSample, bytes]

# The cycle's thread decodes a command with other joints or another order, and rejects a larger
# message, because decoding it would take too long.
_LONGEST = 1024  # [bytes]
_LONGEST_PER_JOINT = 128


class BridgeStreams:
    """Publish joint and motor states and receive joint commands, as serialized messages.

    Parameters
    ----------
    node
        Owner of publishers and subscription.
    names
        Names of the n joints, in the order of all arrays.
    """

    def __init__(self, node: Node, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._cdr = JointStateCdr(names)
        self._power_cdr = Float64ArrayCdr(len(self._names))
        self._node = node
        self._joint_states, self._motor_states, self._motor_power = (
            topic.publisher(node)
            for topic in (topics.JOINT_STATES, topics.MOTOR_STATES, topics.MOTOR_POWER)
        )
        self.commands = RawReader(node, topics.JOINT_COMMAND, identify=True)

    def publish(
        self, stamp_ns: int, joints: Sequence[Array], motors: Sequence[Array], power: Array
    ) -> None:
        """Publish joint states, motor states and motor power of one cycle.

        Parameters
        ----------
        stamp_ns
            Time at which the frames were read [ns since the epoch].
        joints
            Position [rad], velocity [rad/s], effort [Nm], (n,) each.
        motors
            Position [rad], velocity [rad/s], current [A], (n,) each.
        power
            (n,) Electrical power [W].
        """
        self.publish_joints(stamp_ns, joints)
        self._motor_states.publish(self._cdr.pack(stamp_ns, *motors))
        self._motor_power.publish(self._power_cdr.pack(power))

    def publish_joints(self, stamp_ns: int, joints: Sequence[Array]) -> None:
        """Publish `joint_states` only; the parameters are those of `publish`."""
        self._joint_states.publish(self._cdr.pack(stamp_ns, *joints))

    def newest_command(self) -> Command | None:
        """Return the newest joint command since the last call, or None.

        Raises ValueError if the message cannot be decoded.
        """
        message = self.commands.take_newest()
        if message is None:
            return None
        payload, info = message
        publisher = info['publisher']
        sample = self._cdr.unpack(payload)
        if sample is not None:
            return self._names, sample, publisher
        if len(payload) > _LONGEST + _LONGEST_PER_JOINT * len(self._names):
            raise ValueError(
                f'rejected a message on joint_command, because its {len(payload)} bytes are too '
                'many for this arm: check the parameters config and tf_prefix of its publisher'
            )
        return (*decode_as_sent(payload), publisher)

    def destroy(self) -> None:
        """Destroy publishers and subscription."""
        for publisher in (self._joint_states, self._motor_states, self._motor_power):
            self._node.destroy_publisher(publisher)
        self.commands.destroy()
