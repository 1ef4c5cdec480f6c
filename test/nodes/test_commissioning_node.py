"""`arm commission` against the real bridge on emulated boards, over real DDS."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import yaml
from bridge_client import BridgeClient, StartBridge
from rclpy.node import Node

OFF = ('idle', 'unhomed')


def commission(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'arm', 'commission']
    return subprocess.Popen(
        [*command, '--timeout', '100', *map(str, arguments)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, 'PYTHONUNBUFFERED': '1'},
    )


def test_a_joint_is_commissioned_and_its_wrong_sign_is_found(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    record = tmp_path / 'record.yaml'
    start_bridge(commissioning_record=record)
    client = BridgeClient(ros_node)
    client.wait_for(lambda: bool(client.modes) and client.modes[-1] in OFF)
    client.wait_for(lambda: 'the arm is not commissioned' in client.messages['arm'])
    begun = time.monotonic()
    run = commission('--yes', '--joint', 'joint4', '--record', record)
    client.wait_for(lambda: run.poll() is not None or time.monotonic() > begun + 200.0)
    output, _ = run.communicate(timeout=10.0)
    assert run.returncode == 0, output
    assert 'THE ARM MOVES' in output
    assert f'passed: joint4; record: {record}' in output
    assert 'commissioning' in client.modes
    assert client.modes[-1] in OFF
    entry = yaml.safe_load(record.read_text())
    assert entry['emulated'] is True
    assert entry['joints']['joint4']['passed'] is True
    assert abs(entry['joints']['joint4']['reduction'] - 27.0) < 0.5
    # The bridge reads what is written: three joints are left.
    client.wait_for(lambda: 'joint1, joint2, joint3 not commissioned' in client.messages['arm'])

    assert client.set_parameters(fault='wrong_sign:1:1') == []
    run = commission('--joint', 'joint4', '--record', record)
    assert run.stdin is not None
    # A person answers: the joint is placed, turned by the hand, and the way back is left out.
    angles = iter([0.0, 1.5708])
    lines: list[str] = []

    def answer() -> bool:
        assert run.stdout is not None
        line = run.stdout.readline()
        lines.append(line)
        if '[y:' in line:
            angle = next(angles, None)
            if angle is not None:
                start = client.motors[-1].position[3]
                assert client.set_parameters(hand=f'joint4:{angle}') == []
                # However slowly the arm's time passes, the hand gets there.
                way = 0.97 * 27.0 * angle
                client.wait_for(lambda: abs(client.motors[-1].position[3] - start) >= way)  # noqa: B023
                client.spin(1.0)
            run.stdin.write('n\n' if angle is None else 'y\n')
            run.stdin.flush()
        return not line

    while not answer():
        pass
    assert run.wait(timeout=60.0) == 1
    assert (
        'joint4: the encoder counts in the opposite direction to the configuration; set sign: -1'
    ) in ''.join(lines)
    assert yaml.safe_load(record.read_text())['joints']['joint4']['passed'] is False


def test_ctrl_c_switches_the_motor_off(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    start_bridge()
    client = BridgeClient(ros_node)
    client.wait_for(lambda: bool(client.modes) and client.modes[-1] in OFF)
    record = tmp_path / 'record.yaml'
    run = commission('--joint', 'joint1', '--record', record)
    assert run.stdin is not None
    run.stdin.write('n\ny\n')  # nothing is turned by hand, the motor is driven
    run.stdin.flush()
    client.wait_for_mode('commissioning')
    run.send_signal(signal.SIGINT)
    client.wait_for(lambda: client.modes[-1] in OFF)
    client.wait_for(lambda: run.poll() is not None)
    assert run.returncode == 130
    assert not record.exists()
