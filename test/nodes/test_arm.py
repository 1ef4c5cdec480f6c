"""The command line to the bridge, with the real bridge on emulated boards."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from bridge_client import StartBridge
from forked_executable import run
from rclpy.node import Node

from aerarm_ros.nodes.arm import make_parser
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

# The emulated world takes its time on a busy machine.
ASKING = {'enable', 'disable', 'e_stop', 'clear_fault', 'put_back', 'fault', 'go', 'tool', 'set'}
ENABLE = ('enable', '--timeout', '100', '--wait-before', 'idle', '--wait', 'ready')


def ask(*arguments: str) -> tuple[int, str]:
    if set(arguments[:1]) & ASKING and '--timeout' not in arguments:
        arguments += ('--timeout', '100')
    done = run('arm', *arguments)
    return done.returncode, done.stderr + done.stdout


def words(text: str) -> str:
    """Return the output, without the waiting messages of a busy machine."""
    return ''.join(x for x in text.splitlines(True) if not x.startswith('arm: waiting for '))


def test_with_two_bridges_only_stop_requests_go_to_both(
    bridge: NodeProcess, ros_node: Node, tmp_path: Path
) -> None:
    client = ArmClient(ros_node)
    client.wait_for_mode(['idle'], 60.0)
    remap = ('--ros-args', '-r', '__node:=hardware_bridge', '--')
    with NodeProcess(
        'fake_hardware', remap, {'encoders': 'absolute'}, log=tmp_path / 'second.log'
    ) as second:
        while ': idle' not in second.tail(50):
            assert second.returncode is None, second.tail()
            time.sleep(0.05)
        refusal, end = '', time.monotonic() + 120.0
        while not refusal.startswith('several bridges '):
            assert second.returncode is None, second.tail()
            assert time.monotonic() < end, refusal
            try:
                client.call('clear_fault')  # does nothing while only one has been found
            except ArmClientError as error:
                refusal = str(error)
        assert 'hardware_bridge/clear_fault and fake_hardware/clear_fault' in refusal
        told = client.call('e_stop').split('; ')
        names = ('/fake_hardware', '/hardware_bridge')
        assert sorted(told) == [f'{name}: the arm is damped' for name in names]
        client.wait_for_mode(['fault'], 60.0)


def test_an_injected_fault_is_cleared_by_the_recovery_steps(start_bridge: StartBridge) -> None:
    def rejected(*arguments: str) -> str:
        status, text = ask(*arguments)
        assert status == 1, text
        return text

    start_bridge(encoders='incremental')
    assert "then run 'arm home'" in rejected('enable', '--wait-before', 'unhomed')
    home = ('enable', '--home', '--timeout', '100', '--wait', 'ready')
    status, text = ask(*home)
    assert (status, 'homing assumes that the arm is at its home configuration' in text) == (
        0,
        True,
    ), text
    status, text = ask(*home)
    assert (status, 'already enabled' in text) == (0, True), text
    assert ask('disable')[0] == 0
    status, text = ask(*home)
    assert (status, 'the motors align now' in text, 'home configuration' in text) == (
        0,
        True,
        False,
    ), text
    assert 'value 2 of bit_errors must lie in 0 .. 1' in rejected('fault', 'bit_errors:0:0:2')
    status, text = ask('fault', 'encoder_jump:1:0:20')
    assert (status, words(text)) == (0, 'fake_hardware: fault = encoder_jump:1:0:20\n')
    assert 'disable the arm first' in rejected('put_back', '--wait-before', 'fault')
    assert 'rejected' in rejected('enable')
    assert ask('disable')[0] == 0
    assert ask('fault', 'power_cycle:1')[0] == 0
    # The boards switch off in their own time.
    status, text = ask('clear_fault', '--wait', 'unhomed')
    assert (status, 'arm_mode unhomed' in text) == (0, True), text
    status, text = ask('put_back')
    assert (status, 'reset to its initial configuration' in text) == (0, True)
    assert ask('home')[0] == 0


def test_arm_go_reports_success_and_failure(bridge: NodeProcess, tmp_path: Path) -> None:
    posture = ('0.15', '1.5', '-0.1', '0.2')
    # The recorder listens to set_point as well, and moves nothing.
    listening = NodeProcess('recorder', parameters={'bag': str(tmp_path / 'bag')})
    with listening, NodeProcess('gravity_compensation', log=tmp_path / 'controller.log') as node:
        status, text = ask('go', *posture, '--timeout', '100')
        assert (status, "run 'arm enable' first" in text) == (1, True), text
        assert ask(*ENABLE, 'running')[0] == 0
        status, text = ask('go', *posture, '--timeout', '100')
        assert (status, words(text)) == (0, 'the arm has reached its goal\n')
        status, text = ask('go', '0.3', '1.4')
        assert (status, 'the arm needs 4 joint positions [rad], for joint1, joint2' in text) == (
            1,
            True,
        )
        status, text = ask('go', '0', '1.4', '9', '0')
        assert (status, 'rejected: set point: joint3 at 9 rad is outside' in text) == (1, True)
        assert node.stop() == 0
        status, text = ask('go', *posture, '--timeout', '1')
        assert (status, 'no controller subscribes to set_point' in text) == (1, True), text
    with NodeProcess('kinematic_control', log=tmp_path / 'cartesian.log'):
        status, text = ask('tool', '0.16', '0.05', '0.88', '--timeout', '100')
        assert (status, text.splitlines()[-1]) == (0, 'the tool has reached its goal'), text
        status, text = ask('tool', '0', '0', '9')
        assert (status, 'rejected: tool target' in text) == (1, True), text


def test_sets_live_parameters(ros_domain: dict[str, str], tmp_path: Path) -> None:
    node = 'gravity_compensation'
    with NodeProcess(node, log=tmp_path / 'controller.log'):
        status, text = ask('set', node, 'kp', '[20, 25.5, 5, 2]')
        assert (status, words(text)) == (0, f'{node}: kp = [20.0, 25.5, 5.0, 2.0]\n')
        assert ask('set', node, 'hand_guiding', 'true')[0] == 0
        status, text = ask('set', node, 'kd', '5e-1')
        assert (status, words(text)) == (0, f'{node}: kd = [0.5]\n')
        for name, value, problem in (
            ('hand_guide', 'true', "has no parameter 'hand_guide', did you mean 'hand_guiding'?"),
            ('kp', '[-1]', 'rejects the value: parameter kp must be'),
            ('kp', '{', "'{' is not a valid value"),
            ('urdf', 'x', 'is read-only: restart the node with -p urdf:=x'),
        ):
            status, text = ask('set', node, name, value)
            assert (status, problem in text) == (1, True), text
    status, text = ask('set', node, 'kp', '1', '--timeout', '1')
    assert (status, 'node gravity_compensation was not found' in text) == (1, True)


def test_without_a_bridge_the_error_states_what_to_check(
    ros_domain: dict[str, str], tmp_path: Path
) -> None:
    status, text = ask('enable', '--timeout', '1.2')
    assert status == 1
    number = ros_domain['ROS_DOMAIN_ID']
    where = 'on this host only; ground_link connects hosts'
    domain = f'this ROS domain (ROS_DOMAIN_ID={number}, {where})'
    assert f'arm: waiting for a bridge in {domain}\n' in text
    assert f'check that a bridge runs in {domain}' in text
    status, text = ask('e_stop', '--timeout', '0.1')
    assert (status, 'waiting' in text) == (1, False)
    assert f'no bridge offers the service e_stop: check that a bridge runs in {domain}' in text


@pytest.mark.parametrize('arguments', [('0', 'nan'), ('0', '--timeout', 'nan')])
def test_numbers_are_finite(arguments: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as ended:
        make_parser().parse_args(['go', *arguments])
    assert ended.value.code == 2


def test_only_e_stop_has_a_short_time_out() -> None:
    asked = {name: make_parser().parse_args([name]).timeout for name in ('enable', 'hold', 'home')}
    assert asked == {'enable': 20.0, 'hold': 20.0, 'home': 20.0}
    assert make_parser().parse_args(['e_stop']).timeout == 8.0


def test_play_and_record_run_the_other_executables(tmp_path: Path) -> None:
    status, text = ask('play', '012')  # a text, not a number
    assert (status, text.startswith('excitation: 012 cannot be read (No such file')) == (1, True), (
        text
    )
    status, text = ask('record', str(tmp_path))
    assert (status, text.startswith('recorder: ')) == (1, True), text


def test_alone_it_prints_its_help_and_it_completes(tmp_path: Path) -> None:
    status, text = ask()
    assert (status, text.startswith('usage: arm')) == (0, True)
    status, script = ask('completion')
    arm = f'arm() {{ {sys.executable} -m aerarm_ros.executables arm "$@"; }}'
    lines = 'COMP_LINE="arm go --t"; COMP_POINT=10; _python_argcomplete arm; echo "${COMPREPLY[@]}"'
    done = subprocess.run(
        ['bash', '-c', f'{script}\n{arm}\n{lines}'], capture_output=True, text=True
    )
    assert done.stdout.split() == ['--timeout', '--tolerance']
