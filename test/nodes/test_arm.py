"""The command line to the bridge, against the real bridge on emulated boards."""

import time
from pathlib import Path

from rclpy.node import Node

from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError


def ask(log: Path, *arguments: str) -> tuple[int, str]:
    with NodeProcess('arm', arguments, log=log) as process:
        status = process.wait(60.0)
    return status, log.read_text()


def test_a_refusal_is_an_error_and_the_bridge_goes_on(bridge: NodeProcess, tmp_path: Path) -> None:
    log = tmp_path / 'arm.log'
    assert ask(log, 'enable', '--wait-before', 'idle', '--wait', 'ready')[0] == 0
    status, text = ask(log, 'enable', '--wait-before', 'idle', '--wait', 'ready')
    assert (status, 'already enabled' in text) == (0, True)
    status, text = ask(log, 'e_stop', '--wait', 'fault')
    assert (status, 'arm_mode fault' in text) == (0, True)
    status, text = ask(log, 'enable')
    assert status == 1
    assert 'refused' in text
    assert ask(log, 'clear_fault', '--wait', 'idle', 'ready')[0] == 0


def test_with_two_bridges_only_what_stops_goes_to_both(
    bridge: NodeProcess, ros_node: Node, tmp_path: Path
) -> None:
    client = ArmClient(ros_node)
    client.wait_for_mode(['idle'], 30.0)
    remap = ('--ros-args', '-r', '__node:=hardware_bridge', '--')
    with NodeProcess('fake_hardware', remap, log=tmp_path / 'second.log') as second:
        while ': idle' not in second.tail(50):
            assert second.returncode is None, second.tail()
            time.sleep(0.05)
        refusal = ''
        while not refusal:
            assert second.returncode is None, second.tail()
            try:
                client.call('clear_fault')  # does nothing while only one has been found
            except ArmClientError as error:
                refusal = str(error)
        assert 'hardware_bridge/clear_fault and fake_hardware/clear_fault' in refusal
        assert client.call('e_stop') == 'the arm is damped; the arm is damped'
        client.wait_for_mode(['fault'], 30.0)


def test_an_injected_fault_and_the_way_back(bridge: NodeProcess, tmp_path: Path) -> None:
    log = tmp_path / 'arm.log'
    assert ask(log, 'enable', '--wait-before', 'idle', '--wait', 'ready')[0] == 0
    status, text = ask(log, 'fault', 'bit_errors:0:0:2')
    assert (status, 'bit_errors: 2 is not from 0 to 1' in text) == (1, True)
    status, text = ask(log, 'fault', 'encoder_jump:1:0:20')
    assert (status, text) == (0, 'fake_hardware: fault = encoder_jump:1:0:20\n')
    status, text = ask(log, 'put_back', '--wait-before', 'fault')
    assert (status, 'disable first' in text) == (1, True)
    assert ask(log, 'disable')[0] == 0
    assert ask(log, 'fault', 'power_cycle:1')[0] == 0
    # The boards switch off in their own time.
    assert ask(log, 'clear_fault', '--wait', 'idle')[0] == 0
    status, text = ask(log, 'put_back')
    assert (status, 'back where it started' in text) == (0, True)
    assert ask(log, 'enable', '--wait', 'ready')[0] == 0


def test_goes_to_a_posture_and_says_when_it_does_not(bridge: NodeProcess, tmp_path: Path) -> None:
    log = tmp_path / 'arm.log'
    posture = ('0.3', '1.4', '-0.2', '0.4')
    # The recorder listens to set_point as well, and moves nothing.
    listening = NodeProcess('recorder', parameters={'bag': str(tmp_path / 'bag')})
    with listening, NodeProcess('gravity_compensation', log=tmp_path / 'controller.log') as node:
        status, text = ask(log, 'go', *posture)
        assert (status, 'arm enable first' in text) == (1, True), text
        enable = ('enable', '--wait-before', 'idle', '--wait', 'ready', 'running')
        assert ask(log, *enable)[0] == 0
        status, text = ask(log, 'go', *posture)
        assert (status, text) == (0, 'the arm is there\n')
        status, text = ask(log, 'go', '0.3', '1.4')
        assert (status, 'give 4 angles [rad], of joint1, joint2' in text) == (1, True)
        status, text = ask(log, 'go', '0', '1.4', '9', '0')
        assert (status, 'rejected: set point: joint3 at 9 rad is outside' in text) == (1, True)
        assert node.stop() == 0
        status, text = ask(log, 'go', *posture, '--timeout', '3')
        assert (status, 'no controller takes a set_point' in text) == (1, True), text
    assert ask(log, 'go', '0', 'nan')[0] == 2
    assert ask(log, 'go', '0', '--timeout', 'nan')[0] == 2


def test_sets_live_parameters(ros_domain: dict[str, str], tmp_path: Path) -> None:
    log, node = tmp_path / 'arm.log', 'gravity_compensation'
    with NodeProcess(node, log=tmp_path / 'controller.log'):
        status, text = ask(log, 'set', node, 'kp', '[20, 25.5, 5, 2]')
        assert (status, text) == (0, f'{node}: kp = [20.0, 25.5, 5.0, 2.0]\n')
        assert ask(log, 'set', node, 'hand_guiding', 'true')[0] == 0
        status, text = ask(log, 'set', node, 'kd', '5e-1')
        assert (status, text) == (0, f'{node}: kd = [0.5]\n')
        for name, value, problem in (
            ('hand_guide', 'true', "has no parameter 'hand_guide': did you mean 'hand_guiding'?"),
            ('kp', '[-1]', 'refuses: parameter kp must be'),
            ('kp', '{', "'{' is no value of a parameter"),
            ('urdf', 'x', 'reads urdf once: give it when the node starts, -p urdf:=x'),
        ):
            status, text = ask(log, 'set', node, name, value)
            assert (status, problem in text) == (1, True), text
    status, text = ask(log, 'set', node, 'kp', '1', '--timeout', '1')
    assert (status, 'no node gravity_compensation' in text) == (1, True)


def test_without_a_bridge_it_says_what_to_check(ros_domain: dict[str, str], tmp_path: Path) -> None:
    status, text = ask(tmp_path / 'arm.log', 'enable', '--timeout', '1')
    assert status == 1
    assert 'is a bridge running in this ROS domain' in text
