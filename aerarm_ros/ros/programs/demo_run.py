"""Steps of the demo: move the emulated arm, record, identify, and check the accuracy."""

from __future__ import annotations

import argparse
import atexit
import json
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from subprocess import TimeoutExpired

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from aerarm_ros.description.resources import resource
from aerarm_ros.hardware.bridge_modes import OFF
from aerarm_ros.ros.process.node_process import (
    NodeProcess,
    find_log_directory,
    use_packaged_profile,
)
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError

_CYCLES = re.compile(
    '\\d+ cycles, the simulation ran at [\\d.]+ % of real time(?P<slow>.*too slow.*)?$',
    re.MULTILINE,
)
_MESSAGES = re.compile(r'\d+ messages, (?P<lost>\d+|unknown) lost$', re.MULTILINE)
_ADVICE = (
    'close other programs, and give the nodes real-time priority (docs/how-to/raspberry_pi.md, '
    '"Real time")'
)


@dataclass(frozen=True)
class DemoAccount:
    """Final log lines of the bridge and of the recorders.

    Attributes
    ----------
    cycles
        Number of the bridge's cycles.
    too_slow
        Whether the host is too slow for a real arm.
    messages
        Number of messages that the recorder wrote, of each motion.
    lost
        Number of lost messages, of each motion; None if the middleware does not number them.
    """

    cycles: str
    too_slow: bool
    messages: Mapping[str, str]
    lost: Mapping[str, int | None]

    @classmethod
    def read(cls, bridge: Path, recorders: Mapping[str, Path]) -> DemoAccount:
        """Read the logs of the bridge and of the recorders, by the motions' names.

        Raises
        ------
        ValueError
            If a log has no final line.
        """
        cycles = _last(_CYCLES, bridge)
        messages = {name: _last(_MESSAGES, log) for name, log in recorders.items()}
        return cls(
            cycles[0],
            cycles['slow'] is not None,
            {name: found[0] for name, found in messages.items()},
            {name: _count(found['lost']) for name, found in messages.items()},
        )

    def lines(self) -> Iterator[str]:
        """Yield the demo's final lines, with the warnings last."""
        yield f'Bridge    {self.cycles}'
        for name, text in self.messages.items():
            yield f'Recorder  {name}: {text}'
        if self.too_slow:
            yield (
                'NOTE      the simulation waited for this computer, so the results are valid; a '
                f'real arm would not wait: {_ADVICE}'
            )
        if any(self.lost.values()):
            lost = sum(filter(None, self.lost.values()))
            yield f'WARNING   the bags lack {lost} messages: {_ADVICE}'


def _count(text: str) -> int | None:
    return None if text == 'unknown' else int(text)


def _last(pattern: re.Pattern[str], log: Path) -> re.Match[str]:
    found = list(pattern.finditer(log.read_text(errors='replace')))
    if not found:
        raise ValueError(f'{log} has no line {pattern.pattern!r}, because the process ended early')
    return found[-1]


# [s] A slow or busy computer needs long to load its libraries and to simulate the arm.
_START_TIME = 120
_PATIENCE = 300.0


class DemoError(RuntimeError):
    """A step of the demo failed; the message states the step and its log."""


@dataclass(frozen=True)
class Motion:
    """One recorded motion of the arm: its description and the parameters of `excitation`."""

    name: str
    what: str
    trajectory: Mapping[str, object]
    bag: Path


class DemoRun:
    """The suite's nodes, run one after the other, with one output directory.

    Parameters
    ----------
    out
        Directory with an empty directory `logs`.
    options
        Parsed arguments of the demo.
    """

    def __init__(self, out: Path, options: argparse.Namespace) -> None:
        self._out = out
        self._logs = out / 'logs'
        self._options = options
        self._motions = (
            Motion(
                'identification',
                'designed',
                {'trajectory': resource('config', 'designed_motion.yaml')},
                out / 'identification_bag',
            ),
            Motion(
                'validation',
                f'random, seed {options.seed}',
                {'seed': options.seed},
                out / 'validation_bag',
            ),
        )

    def move_and_record(self) -> DemoAccount:
        """Move the emulated arm along the motions; return the final lines of the nodes.

        Raises
        ------
        DemoError, ArmClientError
            If a node fails or the arm does not follow.
        """
        hardware = NodeProcess(
            'fake_hardware',
            parameters={
                'seed': self._options.arm_seed,
                'pace': self._options.pace,
                'truth_file': self._out / 'truth.yaml',
                'realtime_priority': self._options.priority,
            },
            log=self._logs / 'fake_hardware.log',
        )
        with hardware:
            client = _arm_client()
            print('Arm       emulated boards are starting', flush=True)
            _wait_for_bridge(hardware, client)
            print('Arm       homing: the joints turn to their index pulses', flush=True)
            client.call('home')
            client.wait_for_mode(['ready'], _PATIENCE)
            for motion in self._motions:
                self._run_motion(motion)
        if hardware.returncode != 0:
            raise DemoError(
                f'fake_hardware ended with status {hardware.returncode}:\n{hardware.tail()}'
            )
        try:
            return DemoAccount.read(
                self._logs / 'fake_hardware.log',
                {motion.name: self._recorder_log(motion) for motion in self._motions},
            )
        except ValueError as error:
            raise DemoError(str(error)) from None

    def identify(self) -> None:
        """Identify the model and check the demo's promised accuracy; raises DemoError."""
        (identification, validation), out = self._motions, self._out
        arguments = ['--bag', str(identification.bag), '--validation', str(validation.bag)]
        arguments += ['--truth', str(out / 'truth.yaml'), '--out', str(out / 'result')]
        with NodeProcess('identifier', arguments) as identifier:
            _wait(identifier, 2 * _PATIENCE)
        # The demo checks its promised accuracy.
        solvers = json.loads((out / 'result' / 'summary.json').read_text())['solvers']
        if not solvers['sdp']['physically_consistent']:
            raise DemoError('the identified model is not physically consistent: check the report')
        cad, identified = (solvers[name]['validation'][0]['filtered'] for name in ('cad', 'sdp'))
        if identified > 0.5 * cad:
            raise DemoError(
                f'the identified model (error {identified:.1f} %) is not clearly better than '
                'CAD: check the report'
            )

    def _run_motion(self, motion: Motion) -> None:
        options = self._options
        with ExitStack() as stack:
            recorder = stack.enter_context(
                NodeProcess(
                    'recorder',
                    parameters={'bag': motion.bag},
                    log=self._recorder_log(motion),
                )
            )
            print(f'Motion    {motion.name} ({motion.what})', flush=True)
            # Two nodes that start at once can delay each other by some seconds, in which the
            # recorder misses messages.
            _wait_for_recorder(recorder)
            excitation = stack.enter_context(
                NodeProcess(
                    'excitation',
                    parameters={
                        **motion.trajectory,
                        'periods': options.periods,
                        'subscribers': 2,
                        'wait_for_recorder': True,
                        'wait_timeout': _PATIENCE,
                        'realtime_priority': max(0, options.priority - 1),
                    },
                )
            )
            _wait(excitation, _PATIENCE * (2 + options.periods))
            if recorder.returncode is not None:
                raise DemoError(f'recorder ended early:\n{recorder.tail()}')
        if recorder.returncode != 0:
            raise DemoError(f'recorder ended with status {recorder.returncode}:\n{recorder.tail()}')

    def _recorder_log(self, motion: Motion) -> Path:
        return self._logs / f'recorder_{motion.name}.log'


def _wait_for_bridge(hardware: NodeProcess, client: ArmClient) -> None:
    for _ in range(_START_TIME):
        try:
            return client.wait_for_mode(OFF, timeout=1.0)
        except ArmClientError:
            if hardware.returncode is not None:
                raise DemoError(
                    f'fake_hardware ended with status {hardware.returncode}:\n{hardware.tail()}'
                ) from None
    raise DemoError(f'fake_hardware is not ready after {_START_TIME} s: check {hardware.log}')


def _wait_for_recorder(recorder: NodeProcess) -> None:
    deadline = time.monotonic() + _PATIENCE
    while 'publishers found' not in recorder.tail():
        if recorder.returncode is not None:
            raise DemoError(f'recorder ended early:\n{recorder.tail()}')
        if time.monotonic() > deadline:
            raise DemoError(f'recorder is not ready after {_PATIENCE:g} s: check {recorder.log}')
        time.sleep(0.05)


def _arm_client() -> ArmClient:
    use_packaged_profile()
    find_log_directory()
    # Ctrl-C and SIGTERM raise KeyboardInterrupt in the demo, while the context is still valid.
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('demo')
    # The end of the node may hit its time limit, so the table is printed before.
    atexit.register(_leave, node)
    return ArmClient(node, ['fake_hardware'])


def _leave(node: Node) -> None:
    node.destroy_node()
    rclpy.try_shutdown()


def _wait(process: NodeProcess, timeout: float) -> None:
    """Wait for a process to succeed; raises DemoError on failure or after `timeout` [s]."""
    try:
        status = process.wait(timeout)
    except TimeoutExpired:
        raise DemoError(f'{process.name} did not end within {timeout:g} s') from None
    if status != 0:
        raise DemoError(f'{process.name} ended with {status}')
