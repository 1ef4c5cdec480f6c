"""The emergency stop of the command line, with bridges of any name."""

import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from answering_bridges import AnsweringBridges, until_offered
from forked_executable import run
from rclpy.node import Node

from aerarm_ros.ros.executors import BackgroundExecutor
from aerarm_ros.ros.process.node_process import NodeProcess

WAITING = b'arm: waiting for '
LEFT = ('--ros-args', '-r', '__ns:=/left', '--')


def stop(*arguments: str) -> list[str]:
    done = run('arm', 'e_stop', '--timeout', '100', *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.usefixtures('ros_domain')
def test_e_stop_finds_bridges_of_any_name_and_namespace(tmp_path: Path) -> None:
    given = {'pace': 'lockstep', 'encoders': 'absolute'}
    with ExitStack() as stack:
        processes = [
            stack.enter_context(
                NodeProcess(
                    'fake_hardware',
                    ('--ros-args', *remaps, '--'),
                    given,
                    log=tmp_path / f'{len(remaps)}.log',
                )
            )
            for remaps in (('-r', '__node:=my_arm'), ('-r', '__ns:=/left', '-r', '__node:=other'))
        ]
        # The mode of a bridge in another namespace is awaited.
        enable = ('enable', '--bridge', '/left/other', '--wait', 'ready', '--timeout', '100')
        done = run('arm', *enable)
        assert (done.returncode, done.stdout.endswith('arm_mode ready\n')) == (0, True), done
        hint = 'Found the bridges /left/other and /my_arm: select one with --bridge NAME'
        until(lambda: hint in run('arm', 'enable', '--timeout', '1.5').stderr)
        # A computer that is held up may find the second only the next time.
        told = {f'{name}: the arm is damped' for name in ('/left/other', '/my_arm')}
        until(lambda: set(stop('--all', *LEFT)) == told)
        for process in processes:
            until(lambda process=process: 'stop: service e_stop' in process.tail(100))
        # What lets an arm sink stays where it was asked for, and so does a stop that names an arm.
        done = run('arm', 'disable', '--timeout', '100', *LEFT)
        assert (done.returncode, done.stdout.startswith('/left/other: ')) == (0, True)
        assert '/my_arm' not in done.stdout
        assert stop('--bridge', 'my_arm') == ['/my_arm: the arm is damped']


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
