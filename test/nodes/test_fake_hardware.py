"""The bridge on emulated boards as a separate process, over real DDS."""

import itertools
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import yaml
from bridge_client import JOINTS, BridgeClient, StartBridge, velocity_command
from diagnostic_msgs.msg import DiagnosticArray
from forked_executable import run
from quick_spinning import spin_until
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

from aerarm_msgs_py import topics
from aerarm_ros.ros.process.node_process import NodeProcess, ros_environment


@pytest.mark.pace('real_time')
def test_publishes_states_of_all_joints_and_motors_on_a_grid_of_a_millisecond(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    process = start_bridge(use_sim_time=True, base_motion_profile='tilted')
    client = BridgeClient(ros_node)
    received: set[str] = set()
    kinds = {'joint_states': JointState, 'motor_states': JointState, 'imu': Imu}
    for name, kind in {**kinds, 'motor_power': Float64MultiArray}.items():
        # The default QoS, as in tutorials.
        ros_node.create_subscription(kind, name, lambda _, name=name: received.add(name), 10)
    client.wait_for(lambda: len(client.states) > 100 and bool(client.powers) and len(received) == 4)
    assert client.states[-1].name == JOINTS
    q, motor = np.array(client.states[-1].position), np.array(client.motors[-1].position)
    assert np.allclose(q, motor * [1 / 31, 1 / 27, 1 / 31, 1 / 27], atol=1e-3)
    assert len(client.powers[-1].data) == 4
    stamps = [s.header.stamp.sec + 1e-9 * s.header.stamp.nanosec for s in client.states]
    assert np.all(np.diff(stamps) > 0)
    client.wait_for(lambda: 'cycles' in client.diagnostics.get('timing', {}))
    first, begun = client.diagnostics['timing'], client.diagnosed
    assert [stamps[-1], begun] == pytest.approx([time.time()] * 2, abs=20.0)
    assert process.tail(50).count('use_sim_time has no effect') == 1
    # A report is stamped some cycles after it was counted, and a pause may lie in between, which
    # matters less the more time has passed.
    for least in (1.0, 3.0, 10.0, 60.0):
        client.wait_for(lambda least=least: client.diagnosed - begun > least)
        passed = client.diagnosed - begun
        cycles, missed = (
            int(client.diagnostics['timing'][key]) - int(first[key])
            for key in ('cycles', 'missed cycles')
        )
        # However busy the machine is: what isn't run is counted as missed.
        if cycles + missed == pytest.approx(1000 * passed, rel=0.05):
            break
    assert cycles + missed == pytest.approx(1000 * passed, rel=0.05)
    assert cycles > 0


def logged_modes(bridge: NodeProcess) -> list[str]:
    """Return severity and mode of the log's lines about modes."""
    line = r'\[(\w+)\] \[[\d.]+\] \[\w+\]: (idle|aligning|ready|fault|disc\w+)'
    return [f'{severity} {mode}' for severity, mode in re.findall(line, bridge.tail(100))]


def test_boards_that_do_not_answer_are_named_once(
    start_bridge: StartBridge, ros_node: Node
) -> None:
    bridge = start_bridge(fault='dead_board:0')
    client = BridgeClient(ros_node)
    client.wait_for(lambda: 'WARN disconnected' in logged_modes(bridge))
    assert logged_modes(bridge) == ['WARN disconnected']
    assert 'no answer from board0: check supply' in bridge.tail(50)


def assert_ends_cleanly(bridge: NodeProcess, sent: signal.Signals) -> None:
    assert bridge.stop(sent) == 0
    assert 'cycles' in bridge.tail()
    assert 'Traceback' not in bridge.tail(100)


def test_motors_stay_off_until_enabled_then_follow_a_velocity_until_an_e_stop(
    client: BridgeClient, bridge: NodeProcess, tmp_path: Path
) -> None:
    client.wait_for_mode('idle')
    truth = yaml.safe_load((tmp_path / 'truth.yaml').read_text())
    assert truth['joint_names'] == JOINTS
    assert len(truth['parameters']) >= 48
    assert client.call('enable').success
    client.wait_for_mode('ready')
    assert 'aligning' in client.modes
    start = np.array(client.states[-1].position)
    client.answer = lambda state: velocity_command(state, [0.2, -0.1, 0.2, 0.2])
    client.wait_for_mode('running')
    client.wait_for(lambda: client.states[-1].position[0] - start[0] > 0.3)
    moved = np.array(client.states[-1].position) - start
    assert moved[1] == pytest.approx(-moved[0] / 2, abs=0.08)  # joint 2 sags under the weight
    assert moved[2:] == pytest.approx(moved[0], abs=0.05)

    assert client.call('e_stop').success
    client.wait_for_mode('fault')
    client.answer = None
    assert not client.call('enable').success
    client.wait_for(lambda: 'emergency stop' in client.messages.get('arm', ''))
    assert client.call('clear_fault').success
    client.wait_for(lambda: logged_modes(bridge)[-1] == 'INFO ready')
    held = ['INFO idle', 'INFO aligning', 'INFO ready']
    assert logged_modes(bridge) == [*held, 'ERROR fault', 'INFO ready']
    hint = "fault: emergency stop: service e_stop. To recover: 'arm clear_fault'"
    assert hint in bridge.tail(100)
    assert_ends_cleanly(bridge, signal.SIGINT)


def changed(**change: object) -> Callable[[JointState], object]:
    """Return what makes a slow motion's command that is not in order."""

    def command(state: JointState) -> JointState:
        message = velocity_command(state, change.get('velocity', [0.1, 0.0, 0.0, 0.0]))
        message.name = change.get('name', JOINTS)
        message.header.stamp.sec = change.get('stamp', message.header.stamp.sec)
        return message

    return command


def cut_off(state: JointState) -> bytes:
    return serialize_message(velocity_command(state, [0.1] * 4))[:60]


def longer_than_any_command(state: JointState) -> JointState:
    # To read it would take the cycle longer than the boards wait.
    return JointState(header=state.header, name=['joint'] * 20_000)


BAD_COMMANDS = [
    ('names', changed(name=['joint1', 'joint2', 'joint3', 'elbow'])),
    ('nan', changed(velocity=[math.nan, 0.0, 0.0, 0.0])),
    ('infinite', changed(velocity=[math.inf, 0.0, 0.0, 0.0])),
    ('length', changed(velocity=[0.0, 0.0, 0.0])),
    ('stale', changed(stamp=0)),
    ('unreadable', cut_off),
    ('unreadable', longer_than_any_command),
]
REASONS = {reason for reason, _ in BAD_COMMANDS}


def test_bad_commands_are_rejected_and_counted_and_the_arm_held(
    client: BridgeClient, bridge: NodeProcess
) -> None:
    client.make_ready()
    start = client.states[-1].position[0]

    def rejected(reason: str) -> int:
        return int(client.diagnostics.get('arm', {}).get(f'rejected {reason}', 0))

    makes = itertools.cycle(make for _, make in BAD_COMMANDS)
    client.answer = lambda state: client.commands.publish(next(makes)(state))
    # Two of them are unreadable.
    client.wait_for(lambda: all(rejected(r) > 20 * (1 + (r == 'unreadable')) for r in REASONS))
    assert client.modes[-1] == 'ready'
    assert client.states[-1].position[0] == pytest.approx(start, abs=2e-3)
    assert client.diagnostics['arm']['commands accepted'] == '0'
    assert_ends_cleanly(bridge, signal.SIGHUP)


def test_a_closed_terminal_switches_the_motors_off(ros_node: Node) -> None:
    master, slave = os.openpty()
    # The terminal is the process's own, as a shell's: closing it sends SIGHUP, and what is
    # written from then on fails.
    command = ['setsid', '--ctty', sys.executable, '-m', 'aerarm_ros.executables', 'fake_hardware']
    command += ['--ros-args', '-p', 'encoders:=absolute']
    with subprocess.Popen(
        command, env=ros_environment(), stdin=slave, stdout=slave, stderr=slave
    ) as bridge:
        try:
            os.close(slave)
            client = BridgeClient(ros_node)
            client.make_ready()
            os.close(master)
            client.wait_for_mode('inactive')  # the boards have been told
            assert bridge.wait(60.0) == 0  # it ended by itself, not by the signal
        finally:
            bridge.kill()


def test_two_arms_have_distinct_diagnostics(ros_node: Node, tmp_path: Path) -> None:
    found: dict[str, str] = {}

    def store(message: DiagnosticArray) -> None:
        found.update({status.name: status.hardware_id for status in message.status})

    topic = topics.DIAGNOSTICS
    ros_node.create_subscription(topic.type, topic.name, store, topic.qos)
    namespace = ('--ros-args', '-r', '__ns:=/left', '--')
    names = {'/left/fake_hardware: timing', '/left/base_reaction: base_reaction'}
    with ExitStack() as stack:
        for name in ('fake_hardware', 'base_reaction'):
            stack.enter_context(NodeProcess(name, namespace, log=tmp_path / name))
        assert spin_until(ros_node, lambda: found.keys() >= names, 60.0), found
    assert {found[name] for name in names} == {'left/aerarm'}


def test_bad_parameters_are_one_clear_line(ros_domain: dict[str, str]) -> None:
    for parameters, text in (
        ({'config': '/nowhere/arm.yaml'}, 'arm.yaml'),
        ({'truth_file': '/nowhere/truth.yaml'}, 'truth_file'),
        ({'initial_position': [0.1]}, 'initial_position has 1 values: set one value for each'),
        ({'board_kd': [0.5, 0.1, 0.5, 0.5]}, 'kd of joint2 is 0.1.* falling arm'),
        ({'velocity_factor': 1e9}, 'velocity_factor must be a finite number, from 1.0 to 5.0'),
    ):
        done = run('fake_hardware', parameters=parameters)
        said = done.stderr + done.stdout
        assert (done.returncode, 'Traceback' in said) == (1, False)
        assert re.search(text, said)
