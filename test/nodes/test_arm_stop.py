"""The emergency stop of the command line, with real bridges of any name."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from answering_bridges import AnsweringBridges, until_offered
from forked_executable import run
from rclpy.node import Node

from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

STOPPED = 'emergency stop: service e_stop'
WAITING = b'arm: waiting for a bridge in this ROS domain'
LEFT = ('--ros-args', '-r', '__ns:=/left', '--')


class Bridges:
    """Starts emulated bridges, and waits until they answer."""

    def __init__(self, stack: ExitStack, logs: Path) -> None:
        self._stack, self._logs = stack, logs

    def start(self, log: str, *remaps: str) -> NodeProcess:
        arguments = [part for remap in remaps for part in ('-r', remap)]
        process = NodeProcess(
            'fake_hardware',
            ('--ros-args', *arguments, '--') if remaps else (),
            {'pace': 'lockstep', 'encoders': 'absolute'},
            log=self._logs / log,
        )
        return self._stack.enter_context(process)


@pytest.fixture
def bridges(ros_domain: dict[str, str], tmp_path: Path) -> Iterator[Bridges]:
    with ExitStack() as stack:
        yield Bridges(stack, tmp_path)


def stop(*arguments: str) -> list[str]:
    done = run('arm', 'e_stop', '--timeout', '100', *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def until_said(process: NodeProcess, text: str) -> None:
    until(lambda: text in process.tail(100))


def test_e_stop_finds_bridges_of_any_name_and_namespace(bridges: Bridges) -> None:
    renamed = bridges.start('renamed', '__node:=my_arm')
    left = bridges.start('left', '__ns:=/left', '__node:=other')
    for process in (renamed, left):
        until_said(process, ': idle')
    hint = 'Found the bridges /left/other and /my_arm: select one with --bridge NAME'
    until(lambda: hint in run('arm', 'enable', '--timeout', '3').stderr)
    # A computer that is held up may find the second only the next time.
    told = {f'{name}: the arm is damped' for name in ('/left/other', '/my_arm')}
    until(lambda: set(stop('--all', *LEFT)) == told)
    # Without --all its own arm only, and all arms where it has none.
    until(lambda: stop(*LEFT) == ['/left/other: the arm is damped'])
    until(lambda: set(stop('--ros-args', '-r', '__ns:=/elsewhere')) == told)
    for process in (renamed, left):
        until_said(process, STOPPED)
    # What lets an arm sink stays where it was asked for, and so does a stop that names an arm.
    done = run('arm', 'disable', '--timeout', '100', *LEFT)
    assert (done.returncode, done.stdout.startswith('/left/other: ')) == (0, True)
    assert '/my_arm' not in done.stdout
    assert stop('--bridge', 'my_arm') == ['/my_arm: the arm is damped']


def test_the_mode_of_a_bridge_in_another_namespace_is_waited_for(bridges: Bridges) -> None:
    until_said(bridges.start('left', '__ns:=/left'), ': idle')
    enable = ('enable', '--bridge', '/left/fake_hardware', '--wait', 'ready', '--timeout', '100')
    done = run('arm', *enable)
    assert (done.returncode, done.stderr) == (0, '')


def test_e_stop_reaches_all_bridges_if_its_output_cannot_be_written(ros_node: Node) -> None:
    bridges = AnsweringBridges()

    def appear() -> None:
        bridges.add('fake_hardware', ['e_stop'])
        until_offered(ros_node, 'fake_hardware/e_stop')

    bridges.add('hardware_bridge', ['e_stop'], appear)
    command = [sys.executable, '-m', 'aerarm_ros.executables', 'arm', 'e_stop', '--timeout', '100']
    with BackgroundExecutor(bridges.node), open('/dev/full', 'w') as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, timeout=300)
    # A busy host may need seconds to discover the bridges, which is announced.
    said = [line for line in done.stderr.splitlines() if not line.startswith(WAITING)]
    assert (done.returncode, said) == (0, [])
    assert set(bridges.asked) == {'hardware_bridge', 'fake_hardware'}


def test_two_bridges_of_one_name_are_reported_and_not_enabled(
    bridges: Bridges, ros_node: Node
) -> None:
    client = ArmClient(ros_node)
    twins = [bridges.start(log) for log in ('first', 'second')]
    for process in twins:
        until_said(process, ': idle')
    until(lambda: ros_node.count_services('fake_hardware/enable') == 2)
    problem = 'found 2 nodes named /fake_hardware: stop all but one'
    with pytest.raises(ArmClientError, match=problem):
        client.call('enable', 0.5)
    # Both are stopped, but only one can be heard.
    with pytest.raises(ArmClientError, match=problem):
        client.call('e_stop', 100.0)
    for process in twins:
        until_said(process, STOPPED)
        assert ': aligning' not in process.tail(100)
