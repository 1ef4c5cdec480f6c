"""The command line to the bridge, against the real bridge on emulated boards."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rclpy.node import Node

from aerarm_ros.nodes.arm_client import ArmClient, ArmClientError
from aerarm_ros.nodes.node_process import NodeProcess


@pytest.fixture
def bridge(ros_domain: dict[str, str], tmp_path: Path) -> Iterator[NodeProcess]:
    with NodeProcess('fake_hardware', log=tmp_path / 'bridge.log') as process:
        yield process


def ask(log: Path, *arguments: str) -> tuple[int, str]:
    with NodeProcess('arm', arguments, log=log) as process:
        status = process.wait(60.0)
    return status, log.read_text()


def test_enables_stops_and_clears(bridge: NodeProcess, tmp_path: Path) -> None:
    log = tmp_path / 'arm.log'
    assert ask(log, 'enable', '--wait-before', 'idle', '--wait', 'ready')[0] == 0
    status, text = ask(log, 'e_stop', '--wait', 'fault')
    assert status == 0
    assert 'arm_mode fault' in text
    assert ask(log, 'clear_fault', '--wait', 'idle', 'ready')[0] == 0
    assert bridge.returncode is None


def test_a_refusal_is_an_error_and_the_bridge_goes_on(bridge: NodeProcess, tmp_path: Path) -> None:
    log = tmp_path / 'arm.log'
    assert ask(log, 'enable', '--wait-before', 'idle', '--wait', 'ready')[0] == 0
    status, text = ask(log, 'enable', '--wait-before', 'idle', '--wait', 'ready')
    assert (status, 'already enabled' in text) == (0, True)
    assert ask(log, 'e_stop', '--wait', 'fault')[0] == 0
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


def test_without_a_bridge_it_says_what_to_check(ros_domain: dict[str, str], tmp_path: Path) -> None:
    status, text = ask(tmp_path / 'arm.log', 'enable', '--timeout', '1')
    assert status == 1
    assert 'is a bridge running in this ROS domain' in text
