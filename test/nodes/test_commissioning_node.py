"""`arm commission` against the real bridge on emulated boards, over real DDS."""

import os
import signal
import subprocess
import sys
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


def test_a_joint_is_commissioned_after_an_interrupted_and_a_declined_attempt(
    start_bridge: StartBridge, ros_node: Node, tmp_path: Path
) -> None:
    record = tmp_path / 'record.yaml'
    start_bridge(commissioning_record=record)
    client = BridgeClient(ros_node)
    client.wait_for(lambda: bool(client.modes) and client.modes[-1] in OFF)
    client.wait_for(lambda: 'the arm is not commissioned' in client.messages['arm'])

    # Ctrl-C switches the motor off.
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

    run = commission('--joint', 'joint4', '--record', record)
    output, _ = run.communicate('n\nn\n', timeout=100.0)
    assert run.returncode == 1
    assert 'joint4: skipped by the user' in output
    assert yaml.safe_load(record.read_text())['joints']['joint4']['passed'] is False

    client.modes.clear()
    run = commission('--yes', '--joint', 'joint4', '--record', record)
    client.wait_for(lambda: run.poll() is not None, 200.0)
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
