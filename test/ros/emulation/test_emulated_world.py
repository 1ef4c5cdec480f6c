"""Simulation time of the emulated arm during pauses of the host or of a controller."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from bridge_client import BridgeClient, StartBridge, velocity_command
from lifecycle_msgs.srv import ChangeState
from quick_excitation import quick
from quick_spinning import spin_until
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.node_process import NodeProcess

PERIOD_NS = 1_000_000
PAUSE = 0.4  # [s]


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


@pytest.mark.parametrize('pace', ['keep_up', 'real_time'])
def test_a_pause_of_the_host_does_not_advance_simulation_time(
    start_bridge: StartBridge, ros_node: Node, pace: str
) -> None:
    bridge = start_bridge(pace=pace)
    client = BridgeClient(ros_node)
    client.wait_for(lambda: len(client.states) > 50)
    count, begun = len(client.states), time.monotonic()
    client.wait_for(lambda: len(client.states) > count)
    count, before = len(client.states), stamp_ns(client.states[-1])
    pause(bridge)
    client.wait_for(lambda: len(client.states) > count + 50)
    # This client may be held up as well, and miss some states.
    world, host = stamp_ns(client.states[-1]) - before, time.monotonic() - begun
    if pace == 'keep_up':
        assert 1e-9 * world < host - 0.5 * PAUSE
    else:
        assert steps(client).max() > 0.9e3 * PAUSE


@pytest.mark.pace('keep_up')
def test_the_world_waits_for_a_controller_that_was_paused(
    client: BridgeClient, tmp_path: Path
) -> None:
    client.make_ready()
    parameters = quick(tmp_path, amplitude=0.1, return_to_start=False)
    log = tmp_path / 'excitation.log'
    with NodeProcess('excitation', (), parameters, log=log) as excitation:
        client.wait_for_mode('running')
        for _ in range(3):
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


@pytest.mark.pace('keep_up')
def test_the_clock_equals_the_time_of_the_states_on_the_grid_of_the_period(
    client: BridgeClient, ros_node: Node
) -> None:
    clock: list[int] = []
    ros_node.create_subscription(
        Clock, topics.CLOCK.name, lambda message: clock.append(stamp_ns(message)), topics.CLOCK.qos
    )
    client.wait_for(lambda: len(clock) > 50 and len(client.states) > 50)
    assert all(np.diff(clock) > 0)
    states = {stamp_ns(state) for state in client.states}
    assert states.intersection(clock)
    taken = steps(client)
    assert len(taken) and (taken == taken.round()).all()


def test_in_real_time_there_is_no_clock(start_bridge: StartBridge, ros_node: Node) -> None:
    start_bridge(pace='real_time')
    client = BridgeClient(ros_node)
    client.wait_for(lambda: len(client.states) > 10)
    assert ros_node.count_publishers(topics.CLOCK.name) == 0
    assert abs(time.time_ns() - stamp_ns(client.states[-1])) < 5e9


def lockstep_run(folder: Path, ros_node: Node) -> list[np.ndarray]:
    """Play a short excitation in lockstep; return stamps and numbers of the recorded states.

    Up to the one after the last that was commanded: at what time of the host the player lets the
    arm be held is another in every run.
    """
    folder.mkdir()
    arm = {'pace': 'lockstep', 'encoders': 'absolute', 'seed': 3}
    motion = quick(folder, amplitude=0.1, return_to_start=False, wait_for_recorder=True)
    with NodeProcess('fake_hardware', (), arm, log=folder / 'arm.log'):
        BridgeClient(ros_node).make_ready()
        with NodeProcess('recorder', (), {'bag': folder / 'bag'}, log=folder / 'recorder.log'):
            player = NodeProcess('excitation', (), motion, log=folder / 'excitation.log')
            with player:
                assert player.wait(300.0) == 0, player.tail()
    bag = folder / 'bag'
    series = read_joint_states(bag, topics.JOINT_STATES.name)
    commanded = read_joint_states(bag, topics.JOINT_COMMAND.name).stamp[-1]
    kept = series.stamp < commanded + 1.5e-9 * PERIOD_NS
    return [x[kept] for x in (series.stamp, series.position, series.velocity, series.effort)]


def test_in_lockstep_two_runs_are_the_same_to_the_bit(tmp_path: Path, ros_node: Node) -> None:
    runs = [lockstep_run(tmp_path / name, ros_node) for name in ('first', 'second')]
    assert len(runs[0][0]) > 3000
    # None is missing, none is there twice.
    assert (np.diff(runs[0][0] * 1e9).round() == PERIOD_NS).all()
    for first, second in zip(*runs, strict=True):
        np.testing.assert_array_equal(first, second)


def test_in_lockstep_a_silent_publisher_is_named(start_bridge: StartBridge, ros_node: Node) -> None:
    bridge = start_bridge(answer_timeout=0.3)
    client = BridgeClient(ros_node)  # it has a publisher of joint_command
    client.make_ready()
    said = 'the controller that publishes joint_command does not respond to joint states'
    client.wait_for(lambda: said in bridge.tail(50))
    client.call('enable')  # the wait begins again after it
    client.spin(1.0)
    assert bridge.log.read_text().count(said) == 1
    client.answer = hold
    client.wait_for_mode('running')


def test_in_lockstep_each_silent_controller_is_awaited_once(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    bridge = start_bridge(pace='lockstep', answer_timeout=0.7)
    said = 'within 0.7 s (answer_timeout), so the simulation continues'
    client = BridgeClient(ros_node)
    client.make_ready()
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
        client.spin(1.0)
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


def test_the_world_waits_for_its_recorder(client: BridgeClient, tmp_path: Path) -> None:
    bag = tmp_path / 'bag'
    client.make_ready()
    client.answer = hold
    client.wait_for_mode('running')
    with NodeProcess('recorder', (), {'bag': bag}, log=tmp_path / 'recorder.log') as recorder:
        client.wait_for(lambda: 'joint_command' in recorder.tail())
        stopped = stop_until_the_world_stands(client, recorder)
        begun = stamp_ns(client.states[-1])
        assert begun - stopped < 1_000_000_000  # half a second ahead, and no further
        os.kill(recorder.pid, signal.SIGCONT)
        client.wait_for(lambda: stamp_ns(client.states[-1]) - begun > 1_000_000_000)
    stamps = (read_joint_states(bag, topics.JOINT_STATES.name).stamp * 1e9).round()
    steps = np.diff(stamps[stamps >= stopped])
    assert steps[steps != PERIOD_NS].tolist() == []


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def test_a_world_with_a_drone_does_not_spin_while_it_waits_for_its_recorder(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    drone = resource('config', 'drone.yaml')
    bridge = start_bridge(pace='keep_up', drone_file=drone, answer_timeout=600.0)
    client = BridgeClient(ros_node)
    parameters, log = {'bag': tmp_path / 'bag'}, tmp_path / 'recorder.log'
    with NodeProcess('recorder', (), parameters, log=log) as recorder:
        client.wait_for(lambda: 'joint_states' in recorder.tail())
        stop_until_the_world_stands(client, recorder)
        before, begun = processor_time(bridge.pid), time.monotonic()
        client.spin(1.0)
        # As it would wait for the recorder, which needs the processor more.
        assert processor_time(bridge.pid) - before < 0.5 * (time.monotonic() - begun)
        os.kill(recorder.pid, signal.SIGCONT)


def moving_base_run(folder: Path, ros_node: Node) -> dict[int, bytes]:
    """Hold the arm on a moving base in lockstep; return the recorded states by their stamps."""
    folder.mkdir()
    arm = {'pace': 'lockstep', 'encoders': 'absolute', 'seed': 3, 'base_motion_profile': 'moving'}
    bag, log = folder / 'bag', folder / 'recorder.log'
    with (
        NodeProcess('fake_hardware', (), arm, log=folder / 'arm.log'),
        NodeProcess('recorder', (), {'bag': bag}, log=log) as recorder,
    ):
        client = BridgeClient(ros_node)
        client.make_ready()
        client.wait_for(lambda: 'joint_states' in recorder.tail())
        law = {'base_motion': 'full', 'observer_gain': 20.0}
        with NodeProcess('computed_torque', (), law, log=folder / 'law.log'):
            client.wait_for(lambda: bool(client.states) and stamp_ns(client.states[-1]) > 4e9)
    series = read_joint_states(bag, topics.JOINT_STATES.name)
    rows = np.hstack([series.position, series.velocity, series.effort])
    stamps = (series.stamp * 1e9).round().astype(int).tolist()
    return {stamp: row.tobytes() for stamp, row in zip(stamps, rows, strict=True)}


def test_in_lockstep_imu_and_observer_make_no_difference(tmp_path: Path, ros_node: Node) -> None:
    first, second = (moving_base_run(tmp_path / name, ros_node) for name in ('first', 'second'))
    common = first.keys() & second.keys()
    assert len(common) > 2000, [(min(run), max(run), len(run)) for run in (first, second)]
    assert [stamp for stamp in sorted(common) if first[stamp] != second[stamp]] == []


@pytest.mark.pace('keep_up')
def test_simulation_time_continues_after_a_deactivation(
    client: BridgeClient, ros_node: Node
) -> None:
    service = ros_node.create_client(ChangeState, 'fake_hardware/change_state')
    client.wait_for_mode('idle')
    for transition in (4, 3):  # deactivate, activate
        request = ChangeState.Request()
        request.transition.id = transition
        future = service.call_async(request)
        assert spin_until(ros_node, future.done, 60.0)
        assert future.result().success
    count = len(client.states)
    client.wait_for(lambda: len(client.states) > count + 20)
    assert client.modes[-1] == 'idle'
    assert steps(client).min() > 0
