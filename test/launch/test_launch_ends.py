"""Ends of ros2 launch: before the start, with a controller, on request, killed."""

import os
import re
import select
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import yaml
from launched import LAUNCH_TIMEOUT, is_in_the_index, needs_ros2_launch, ros2_launch

pytestmark = needs_ros2_launch
COMMAND = ('ros2', 'launch', 'aerarm_ros')


@pytest.fixture
def wrong_gains(tmp_path: Path) -> str:
    """Return a parameter file that computed_torque cannot start with."""
    path = tmp_path / 'parameters.yaml'
    wrong = {'/**/computed_torque': {'ros__parameters': {'kp': [1.0, 2.0]}}}
    path.write_text(yaml.safe_dump(wrong))
    return str(path)


class Launched:
    """ros2 launch, with its output, and the processes that it starts."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        self._output = b''

    @property
    def output(self) -> str:
        return self._output.decode(errors='replace')

    @property
    def started(self) -> list[int]:
        return [int(pid) for pid in re.findall(r'process started with pid \[(\d+)\]', self.output)]

    def until(self, text: str, timeout: float = LAUNCH_TIMEOUT) -> None:
        """Read the output until it contains a text; fail after `timeout` [s] or at its end."""
        assert self.process.stdout
        deadline = time.monotonic() + timeout
        while text not in self.output:
            left = max(0.0, deadline - time.monotonic())
            readable, _, _ = select.select([self.process.stdout], [], [], left)
            assert readable, f'no {text!r} within {timeout:g} s in:\n{self.output}'
            part = os.read(self.process.stdout.fileno(), 65536)
            assert part, f'launch ended without {text!r}:\n{self.output}'
            self._output += part
        # A signal while launch is printing would lose it the process it prints of.
        time.sleep(0.5)

    def rest(self) -> str:
        """Wait for the end; return the whole output. Launch is killed if it does not end."""
        try:
            self._output += self.process.communicate(timeout=LAUNCH_TIMEOUT)[0]
        except subprocess.TimeoutExpired:
            self.process.kill()
            self._output += self.process.communicate()[0]
            pytest.fail(f'launch has not ended within {LAUNCH_TIMEOUT:g} s:\n{self.output}')
        return self.output


@pytest.fixture
def start(ros_domain: dict[str, str]) -> Iterator[Callable[..., Launched]]:
    """Return a function that starts launch files; they end with the test."""
    started: list[Launched] = []

    def start(*arguments: str) -> Launched:
        started.append(Launched(*arguments))
        return started[-1]

    yield start
    for launched in started:
        if launched.process.poll() is None:
            launched.process.send_signal(signal.SIGINT)
            launched.rest()


@pytest.fixture
def launched(start: Callable[..., Launched]) -> Launched:
    """Return an arm that computed_torque moves."""
    return start('computed_torque.launch.py', 'enable:=true')


@pytest.mark.parametrize(
    ('argument', 'reason'),
    [
        ('params_file:=/nowhere.yaml', '(argument params_file) does not exist'),
        pytest.param(
            'rviz:=true',
            'rviz:=true needs the ROS package rviz2',
            marks=pytest.mark.skipif(is_in_the_index('rviz2'), reason='rviz2 is installed here'),
        ),
    ],
)
def test_missing_requirements_are_reported_before_the_start(
    argument: str, reason: str, ros_domain: dict[str, str]
) -> None:
    status, output = ros2_launch('bringup', argument, 'enable:=true')
    assert status == 1, output[-3000:]
    assert reason in output
    assert 'process started' not in output


def test_a_controller_that_cannot_start_ends_everything(
    wrong_gains: str, ros_domain: dict[str, str]
) -> None:
    arguments = (f'params_file:={wrong_gains}', 'enable:=true')
    status, output = ros2_launch('computed_torque', *arguments)
    assert status == 1, output[-3000:]
    assert 'kp has 2 values, 4 are needed' in output
    assert 'debug for traceback): controller: exit status 1' in output
    assert '[fake_hardware-1]: process has finished cleanly' in output


def test_with_go_on_the_bridge_survives_the_controller(
    wrong_gains: str, start: Callable[..., Launched]
) -> None:
    go_on = 'if_controller_fails:=go_on'
    launched = start('computed_torque.launch.py', f'params_file:={wrong_gains}', go_on)
    launched.until('process has died')
    launched.until('[fake_hardware]: unhomed')
    launched.process.send_signal(signal.SIGINT)
    assert '[fake_hardware-1]: process has finished cleanly' in launched.rest()
    assert launched.process.returncode == 0


@pytest.mark.parametrize('pause', [0.0, 0.05, 0.2])
def test_two_signals_are_an_ordinary_end(launched: Launched, pause: float) -> None:
    launched.until('[arm-2]: process has finished cleanly')
    # As a terminal does: launch and all that it has started get the same Ctrl-C, launch passes it
    # on, and somebody presses again.
    for _ in range(2):
        for pid in [launched.process.pid, *launched.started]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGINT)
        time.sleep(pause)
    output = launched.rest()
    assert_clean_nodes(launched)
    # A second Ctrl-C may meet launch when its nodes have ended and it has put back Python's own
    # handling of signals: then it dies of that signal, and left nothing to do.
    assert launched.process.returncode in (0, -signal.SIGINT), output
    assert launched.process.returncode or 'Traceback' not in output, output


def assert_clean_nodes(launched: Launched) -> None:
    """Assert that every process has ended with status 0, or with one that launch has not seen."""
    output = launched.output
    clean = re.findall(r'process has finished cleanly \[pid (\d+)\]', output)
    unseen = re.findall(r'process has died \[pid (\d+), exit code 255,', output)
    assert {int(pid) for pid in (*clean, *unseen)} == set(launched.started), output


def test_an_interrupted_motion_ends_launch_with_success(
    tmp_path: Path, start: Callable[..., Launched]
) -> None:
    launched = start('identification.launch.py', f'out:={tmp_path / "run"}')
    launched.until('[fake_hardware]: running')
    for pid in [launched.process.pid, *launched.started]:  # as a terminal does
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGINT)
    output = launched.rest()
    assert launched.process.returncode == 0, output
    assert 'excitation: stopped' in output
    assert 'identifier' not in output
    assert 'Traceback' not in output


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGQUIT, signal.SIGTERM])
def test_nothing_outlives_launch(launched: Launched, number: signal.Signals) -> None:
    launched.until('[fake_hardware]: running')
    assert len(launched.started) == 3  # with arm enable
    launched.process.send_signal(number)
    launched.rest()  # to the end of what they may say
    deadline = time.monotonic() + 60.0
    while any(Path(f'/proc/{pid}').exists() for pid in launched.started):
        assert time.monotonic() < deadline, launched.output
        time.sleep(0.05)
