"""Simulation time of the emulated arm during pauses of the host or of a controller."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bridge_client import BridgeClient, StartBridge, velocity_command
from builtin_interfaces.msg import Time
from lifecycle_msgs.srv import ChangeState
from quick_excitation import quick
from quick_spinning import spin_until
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.emulation.emulated_world import RecordingWatch
from aerarm_ros.ros.process.node_process import NodeProcess

PERIOD_NS = 1_000_000
PAUSE = 0.4  # [s]
START_S = 1_700_000_000  # [s]


def stamp_ns(message: JointState | Clock) -> int:
    stamp = message.clock if isinstance(message, Clock) else message.header.stamp
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def pause(process: NodeProcess, seconds: float = PAUSE) -> None:
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(process.pid, signal.SIGCONT)


def steps(client: BridgeClient) -> np.ndarray:
    """Return the numbers of periods from state to state."""
    return np.diff([stamp_ns(state) for state in client.states]) / PERIOD_NS


def hold(state: JointState) -> JointState:
    return velocity_command(state, [0.0] * 4)


def paused(client: BridgeClient, bridge: NodeProcess) -> tuple[float, float]:
    """Pause a bridge; return how much time passed meanwhile in the world, and on the host [s]."""
    count, begun = len(client.states), time.monotonic()
    client.wait_for(lambda: len(client.states) > count)
    count, before = len(client.states), stamp_ns(client.states[-1])
    pause(bridge)
    client.wait_for(lambda: len(client.states) > count + 50)
    return 1e-9 * (stamp_ns(client.states[-1]) - before), time.monotonic() - begun


@pytest.mark.pace('keep_up')
def test_time_is_on_the_grid_and_stands_during_pauses_of_the_host(
    client: BridgeClient, bridge: NodeProcess, ros_node: Node
) -> None:
    clock: list[int] = []
    ros_node.create_subscription(
        Clock, topics.CLOCK.name, lambda message: clock.append(stamp_ns(message)), topics.CLOCK.qos
    )
    client.wait_for(lambda: len(clock) > 50 and len(client.states) > 50)
    world, host = paused(client, bridge)
    assert world < host - 0.5 * PAUSE
    assert {stamp_ns(state) for state in client.states}.intersection(clock)
    assert (steps(client) == steps(client).round()).all()
    service = ros_node.create_client(ChangeState, 'fake_hardware/change_state')
    for transition in (4, 3):  # deactivate, activate
        request = ChangeState.Request()
        request.transition.id = transition
        future = service.call_async(request)
        assert spin_until(ros_node, future.done, 60.0)
        assert future.result().success
    count = len(client.states)
    client.wait_for(lambda: len(client.states) > count + 20)
    assert client.modes[-1] == 'idle'
    assert all(np.diff(clock) > 0)
    assert steps(client).min() > 0


def test_real_time_passes_during_pauses_and_has_no_clock(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    bridge = start_bridge(pace='real_time')
    client = BridgeClient(ros_node)
    client.wait_for(lambda: len(client.states) > 50)
    paused(client, bridge)
    assert steps(client).max() > 0.9e3 * PAUSE
    assert ros_node.count_publishers(topics.CLOCK.name) == 0
    assert abs(time.time_ns() - stamp_ns(client.states[-1])) < 5e9


@pytest.mark.pace('keep_up')
def test_the_world_waits_for_a_controller_that_was_paused(
    client: BridgeClient, tmp_path: Path
) -> None:
    client.make_ready()
    parameters = quick(tmp_path, amplitude=0.1, fundamental=1.0, return_to_start=False)
    log = tmp_path / 'excitation.log'
    with NodeProcess('excitation', (), parameters, log=log) as excitation:
        client.wait_for_mode('running')
        for _ in range(2):
            pause(excitation)
            client.spin(0.2)
        deadline = time.monotonic() + 300.0
        while excitation.returncode is None and time.monotonic() < deadline:
            client.spin(0.1)
        assert excitation.returncode == 0, log.read_text()
    running = client.modes[client.modes.index('running') :]
    assert 'damping' not in running[: running.index('running') + 1]
    assert client.modes.count('running') == 1


@pytest.mark.pace('keep_up')
def test_a_controller_that_ends_has_the_arm_held_unless_it_is_to_be_released(
    client: BridgeClient, bridge: NodeProcess
) -> None:
    client.make_ready()
    for at_end, mode in (('hold', 'ready'), ('release', 'damping')):
        log = bridge.log.with_name(f'{at_end}.log')
        seen = len(client.modes)
        with NodeProcess('gravity_compensation', (), {'at_end': at_end}, log=log):
            client.wait_for_mode('running')
        client.wait_for_mode(mode)
        assert client.modes[seen:] == ['running', mode]


def test_a_controller_starts_after_the_clock_was_set_back(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    first = start_bridge(pace='keep_up')
    client = BridgeClient(ros_node)
    with NodeProcess('gravity_compensation', log=tmp_path / 'controller.log') as controller:
        client.make_ready()
        client.wait_for_mode('running')
        late = stamp_ns(client.states[-1])
        assert first.stop() == 0
        client.states.clear()
        start_bridge(pace='lockstep')  # its world begins at 0
        client.wait_for(lambda: bool(client.states) and stamp_ns(client.states[-1]) < late)
        client.make_ready()
        client.wait_for_mode('running')
        assert controller.returncode is None, controller.tail()


def test_in_lockstep_requests_are_served_while_the_world_stands(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    start_bridge(pace='lockstep', answer_timeout=60.0)
    client = BridgeClient(ros_node)
    client.make_ready()
    client.answer = hold
    client.wait_for_mode('running')
    client.answer = None
    client.spin(0.5)
    assert client.modes[-1] == 'running'  # no time passes
    assert client.call('enable').message == 'already enabled: the bridge holds the arm in place'
    client.wait_for_mode('ready')
    assert client.call('e_stop').success
    client.wait_for_mode('fault')


def played(folder: Path, ros_node: Node) -> dict[int, bytes]:
    """Play a short excitation in lockstep; return the recorded states by their stamps.

    Up to the one after the last that was commanded: at what time of the host the player lets the
    arm be held is another in every run.
    """
    motion = quick(
        folder, amplitude=0.1, fundamental=1.0, return_to_start=False, wait_for_recorder=True
    )

    def play(client: BridgeClient) -> None:
        with NodeProcess('excitation', (), motion, log=folder / 'excitation.log') as player:
            assert player.wait(300.0) == 0, player.tail()

    states = recorded(folder, ros_node, play)
    commanded = read_joint_states(folder / 'bag', topics.JOINT_COMMAND.name).stamp[-1]
    last = round(1e9 * commanded) + PERIOD_NS
    return {stamp: state for stamp, state in states.items() if stamp <= last}


def swung(folder: Path, ros_node: Node) -> dict[int, bytes]:
    """Hold the arm on a moving base in lockstep; return the recorded states by their stamps."""

    def control(client: BridgeClient) -> None:
        law = {'base_motion': 'full', 'observer_gain': 20.0}
        with NodeProcess('computed_torque', (), law, log=folder / 'law.log'):
            client.wait_for(lambda: bool(client.states) and stamp_ns(client.states[-1]) > 2e9)

    return recorded(folder, ros_node, control, base_motion_profile='moving')


def recorded(
    folder: Path, ros_node: Node, act: Callable[[BridgeClient], None], **world: object
) -> dict[int, bytes]:
    """Return the states that a recorder receives in lockstep, by their stamps [ns]."""
    arm = {'pace': 'lockstep', 'encoders': 'absolute', 'seed': 3, 'answer_timeout': 60.0, **world}
    bag, log = folder / 'bag', folder / 'recorder.log'
    with (
        NodeProcess('fake_hardware', (), arm, log=folder / 'arm.log'),
        NodeProcess('recorder', (), {'bag': bag}, log=log) as recorder,
    ):
        client = BridgeClient(ros_node)
        client.wait_for(lambda: 'joint_states' in recorder.tail())
        client.make_ready()
        act(client)
    series = read_joint_states(bag, topics.JOINT_STATES.name)
    rows = np.hstack([series.position, series.velocity, series.effort])
    stamps = (series.stamp * 1e9).round().astype(int).tolist()
    assert len(set(stamps)) == len(stamps)  # none is there twice
    return {stamp: row.tobytes() for stamp, row in zip(stamps, rows, strict=True)}


@pytest.mark.parametrize(('run', 'least'), [(played, 2000), (swung, 1000)])
def test_in_lockstep_two_runs_are_the_same_to_the_bit(
    tmp_path: Path, ros_node: Node, run: Callable[[Path, Node], dict[int, bytes]], least: int
) -> None:
    runs = []
    for name in ('first', 'second'):
        (tmp_path / name).mkdir()
        runs.append(run(tmp_path / name, ros_node))
    first, second = runs
    common = sorted(first.keys() & second.keys())
    assert len(common) > least
    assert (np.diff(common) == PERIOD_NS).all()  # none is missing
    assert [stamp for stamp in common if first[stamp] != second[stamp]] == []
    assert run is swung or max(first) == max(second)


def test_in_lockstep_each_silent_controller_is_named_and_awaited_once(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    bridge = start_bridge(answer_timeout=0.7)
    client = BridgeClient(ros_node)  # it has a publisher of joint_command
    client.make_ready()
    said = 'the controller that publishes joint_command does not respond to joint states'
    client.wait_for(lambda: said in bridge.tail(50))
    client.call('enable')  # the wait begins again after it
    client.spin(1.0)
    assert bridge.log.read_text().count(said) == 1
    said = 'within 0.7 s (answer_timeout), so the simulation continues'
    for number in (1, 2):
        client.answer = hold
        client.wait_for_mode('running')
        client.answer = None
        client.spin(0.1)
        last = stamp_ns(client.states[-1])
        client.spin(0.1)
        assert stamp_ns(client.states[-1]) == last  # not one state ahead of the answer
        client.wait_for_mode('damping')
        assert bridge.log.read_text().count(said) == number
        assert client.call('enable').success
        client.wait_for_mode('ready')


def stop_until_the_world_stands(client: BridgeClient, recorder: NodeProcess) -> int:
    """Stop a recorder until the simulation waits for it; return the last stamp [ns] before.

    A process that is stopped while it receives a message holds a lock of the middleware and delays
    the publisher for seconds; then it is continued and stopped again.
    """
    client.wait_for(lambda: bool(client.states))
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        client.spin(0.5)
        stopped = stamp_ns(client.states[-1])
        os.kill(recorder.pid, signal.SIGSTOP)
        end = time.monotonic() + 2.5  # Fast DDS takes it for dead after 3 s
        while time.monotonic() < end:
            client.spin(0.05)
            # A world that stands tells its last state again and again, no other one does.
            if len({stamp_ns(state) for state in client.states[-4:]}) == 1:
                return stopped
        os.kill(recorder.pid, signal.SIGCONT)
    raise AssertionError('the world did not wait')


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def test_the_world_waits_for_its_recorder_without_spinning(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    drone, bag = resource('config', 'drone.yaml'), tmp_path / 'bag'
    bridge = start_bridge(pace='keep_up', drone_file=drone, answer_timeout=600.0)
    client = BridgeClient(ros_node)
    client.make_ready()
    client.answer = hold
    with NodeProcess('recorder', (), {'bag': bag}, log=tmp_path / 'recorder.log') as recorder:
        client.wait_for(lambda: 'joint_command' in recorder.tail())
        stopped = stop_until_the_world_stands(client, recorder)
        before, begun = processor_time(bridge.pid), time.monotonic()
        stands = stamp_ns(client.states[-1])
        assert stands - stopped < 1_000_000_000  # half a second ahead, and no further
        client.spin(0.5)
        # As it would wait for the recorder, which needs the processor more.
        assert processor_time(bridge.pid) - before < 0.5 * (time.monotonic() - begun)
        os.kill(recorder.pid, signal.SIGCONT)
        client.wait_for(lambda: stamp_ns(client.states[-1]) - stands > 1_000_000_000)
    stamps = (read_joint_states(bag, topics.JOINT_STATES.name).stamp * 1e9).round()
    steps = np.diff(stamps[stamps >= stopped])
    assert np.abs(steps - PERIOD_NS).max() < 1000  # seconds since the epoch have such a resolution


def test_only_states_of_its_own_world_are_waited_for(ros_node: Node) -> None:
    watch = RecordingWatch(ros_node, START_S * 1_000_000_000)
    publisher = ros_node.create_publisher(
        Time, topics.RECORDED_UNTIL.name, topics.RECORDED_UNTIL.offered
    )
    assert spin_until(ros_node, publisher.get_subscription_count, 60.0)
    now_ns = (START_S + 3) * 1_000_000_000

    def is_behind_after(seconds: int, limit: float = 1.0) -> bool:
        publisher.publish(Time(sec=seconds))
        return bool(spin_until(ros_node, lambda: watch.is_behind(now_ns), limit))

    assert not is_behind_after(1)  # a second bridge's, in lockstep
    assert not is_behind_after(START_S + 3)
    assert is_behind_after(START_S + 1, 60.0)
    watch.destroy()
