"""The command line to the bridge, against the real bridge on emulated boards."""

from collections.abc import Iterator
from pathlib import Path

import pytest

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
    assert ask(log, 'e_stop', '--wait', 'fault')[0] == 0
    status, text = ask(log, 'enable')
    assert status == 1
    assert 'refused' in text
    assert ask(log, 'clear_fault', '--wait', 'idle', 'ready')[0] == 0


def test_without_a_bridge_it_says_what_to_check(ros_domain: dict[str, str], tmp_path: Path) -> None:
    status, text = ask(tmp_path / 'arm.log', 'enable', '--timeout', '1')
    assert status == 1
    assert 'is a bridge running in this ROS domain' in text
