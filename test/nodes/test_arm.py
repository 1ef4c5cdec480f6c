"""The command line to the bridge, with the real bridge on emulated boards."""

from pathlib import Path

import pytest
from bridge_client import StartBridge
from forked_executable import run

from aerarm_ros.nodes.arm import make_parser
from aerarm_ros.ros.process.node_process import NodeProcess

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


def test_an_injected_fault_is_cleared_by_the_recovery_steps(start_bridge: StartBridge) -> None:
    def said(status: int, *arguments: str) -> str:
        found, text = ask(*arguments)
        assert found == status, text
        return text

    start_bridge(encoders='incremental')
    assert "then run 'arm home'" in said(1, 'enable', '--wait-before', 'unhomed')
    home = ('enable', '--home', '--timeout', '100', '--wait', 'ready')
    assert 'homing assumes that the arm is at its home configuration' in said(0, *home)
    said(0, 'disable')
    text = said(0, *home)
    assert ('the motors align now' in text, 'home configuration' in text) == (True, False), text
    assert 'value 2 of bit_errors must lie in 0 .. 1' in said(1, 'fault', 'bit_errors:0:0:2')
    told = words(said(0, 'fault', 'encoder_jump:1:0:20'))
    assert told == 'fake_hardware: fault = encoder_jump:1:0:20\n'
    assert 'disable the arm first' in said(1, 'put_back', '--wait-before', 'fault')
    said(0, 'disable')
    said(0, 'fault', 'power_cycle:1')
    # The boards switch off in their own time.
    assert 'arm_mode unhomed' in said(0, 'clear_fault', '--wait', 'unhomed')
    assert 'reset to its initial configuration' in said(0, 'put_back')


def test_arm_sets_parameters_and_moves_the_arm(bridge: NodeProcess, tmp_path: Path) -> None:
    posture = ('0.15', '1.5', '-0.1', '0.2')
    # The recorder listens to set_point as well, and moves nothing.
    listening = NodeProcess('recorder', parameters={'bag': str(tmp_path / 'bag')})
    with listening, NodeProcess('gravity_compensation', log=tmp_path / 'controller.log') as node:
        status, text = ask('go', *posture, '--timeout', '100')
        assert (status, "run 'arm enable' first" in text) == (1, True), text
        name = 'gravity_compensation'
        status, text = ask('set', name, 'kp', '[20, 25.5, 5, 2]')
        assert (status, words(text)) == (0, f'{name}: kp = [20.0, 25.5, 5.0, 2.0]\n')
        for key, value, problem in (
            ('hand_guide', 'true', "has no parameter 'hand_guide', did you mean 'hand_guiding'?"),
            ('kp', '[-1]', 'rejects the value: parameter kp must be'),
            ('kp', '{', "'{' is not a valid value"),
            ('urdf', 'x', 'is read-only: restart the node with -p urdf:=x'),
        ):
            status, text = ask('set', name, key, value)
            assert (status, problem in text) == (1, True), text
        assert ask('set', name, 'kp', '20')[0] == 0
        assert ask(*ENABLE, 'running')[0] == 0
        status, text = ask('go', *posture, '--timeout', '100')
        assert (status, words(text)) == (0, 'the arm has reached its goal\n')
        for wrong, problem in (
            (('0.3', '1.4'), 'the arm needs 4 joint positions [rad], for joint1, joint2'),
            (('0', '1.4', '9', '0'), 'rejected: set point: joint3 at 9 rad is outside'),
        ):
            status, text = ask('go', *wrong)
            assert (status, problem in text) == (1, True), text
        assert node.stop() == 0
        status, text = ask('go', *posture, '--timeout', '1')
        missing = 'no controller subscribes to set_point'
        assert (status, text.count(missing)) == (1, 2), text  # a notice after 2 s, and the error
        status, text = ask('set', name, 'kp', '1', '--timeout', '1')
        assert (status, f'node {name} was not found' in text) == (1, True)
    with NodeProcess('kinematic_control', log=tmp_path / 'cartesian.log'):
        status, text = ask('tool', '0.16', '0.05', '0.88', '--timeout', '100')
        assert (status, text.splitlines()[-1]) == (0, 'the tool has reached its goal'), text
        status, text = ask('tool', '0', '0', '9')
        assert (status, 'rejected: tool target' in text) == (1, True), text


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


def test_numbers_are_finite_and_only_e_stop_has_a_short_time_out() -> None:
    for arguments in (('0', 'nan'), ('0', '--timeout', 'nan')):
        with pytest.raises(SystemExit) as ended:
            make_parser().parse_args(['go', *arguments])
        assert ended.value.code == 2
    names = ('enable', 'hold', 'home', 'e_stop')
    limits = [make_parser().parse_args([name]).timeout for name in names]
    assert limits == [20.0, 20.0, 20.0, 8.0]


def test_play_and_record_run_the_other_executables(tmp_path: Path) -> None:
    status, text = ask('play', '012')  # a text, not a number
    assert text.startswith('excitation: 012 cannot be read (No such file')
    assert status == 1
    status, text = ask('record', str(tmp_path))
    assert (status, text.startswith('recorder: ')) == (1, True), text


def test_alone_it_prints_its_help() -> None:
    status, text = ask()
    assert (status, text.startswith('usage: arm')) == (0, True)
