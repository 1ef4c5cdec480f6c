"""Nodes that receive a second stop signal during their end, and still end normally."""

import random
import signal
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from asked_twice import COMMAND, LONGEST_GAP, ask_twice

NODES = {
    'fake_hardware': signal.SIGINT,
    'computed_torque': signal.SIGTERM,
    'recorder': signal.SIGINT,
    'tool_path': signal.SIGTERM,
}


def test_the_second_one_changes_nothing(tmp_path: Path, ros_domain: dict[str, str]) -> None:
    # At any time: while they start, at work and while they end.
    chance = random.Random(1)
    times = [(chance.uniform(0.0, 2.5), chance.uniform(0.0, LONGEST_GAP)) for _ in NODES]

    def ask(node: str, time: tuple[float, float]) -> object:
        bag = ('-p', f'bag:={tmp_path / node}') if node == 'recorder' else ()
        return ask_twice(node, bag, *time, NODES[node])

    with ThreadPoolExecutor(len(NODES)) as pool:
        ends = list(pool.map(ask, NODES, times))
    assert [ended for ended in ends if not ended.is_clean] == []


# What reads the command line, made to last.
YAML = 'aerarm_ros.description.config_reader'
READING = (
    'import time, {0}; {1} = lambda *_, **__: (print("reading", flush=True), time.sleep(60.0)); '
)


@pytest.mark.parametrize(
    ('node', 'arguments', 'reader', 'status'),
    [
        (
            'computed_torque',
            ('--ros-args', '--params-file', '/dev/null'),
            (YAML, f'{YAML}.read_plain'),
            0,
        ),
        ('arm', ('enable',), ('argparse', 'argparse.ArgumentParser.parse_args'), 130),
    ],
    ids=['serves', 'has a task'],
)
def test_ctrl_c_while_the_command_line_is_read(
    node: str, arguments: Sequence[str], reader: Sequence[str], status: int
) -> None:
    with subprocess.Popen(
        [sys.executable, '-c', READING.format(*reader) + COMMAND.format(node), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == 'reading\n'
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60.0)[1]
    assert (process.returncode, said) == (status, '')


# A signal each time that the handlers of stop signals have just been taken away.
AS_THEY_GO = (
    'import os, signal; from aerarm_ros.ros.process.process_end import StopSignals; '
    'leave = StopSignals.__exit__; '
    'ask = lambda: os.kill(os.getpid(), {}); '
    'StopSignals.__exit__ = lambda *given: (leave(*given), ask())[0]; '
)


@pytest.mark.parametrize(
    ('node', 'number', 'status'),
    [('computed_torque', signal.SIGTERM, 0), ('excitation', signal.SIGINT, 130)],
)
def test_a_signal_as_the_last_handler_goes(node: str, number: signal.Signals, status: int) -> None:
    code = AS_THEY_GO.format(int(number)) + COMMAND.format(node)
    command = [sys.executable, '-c', code, '--help']
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300.0)
    assert (done.returncode, done.stderr) == (status, '')
