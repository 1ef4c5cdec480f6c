"""`demo`: move the emulated arm, record its motion, identify a model, and check the accuracy."""

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
    """Last log lines of the bridge and of the recorders, which the demo prints at its end.

    Attributes
    ----------
    cycles
        Log line with the number of the bridge's cycles.
    too_slow
        Whether this computer is too slow for a real arm.
    messages
        Log line with the number of recorded messages, by the name of the motion.
    lost
        Number of lost messages by the name of the motion, or None if the middleware does not number
        messages.
    """

    cycles: str
    too_slow: bool
    messages: Mapping[str, str]
    lost: Mapping[str, int | None]

    @classmethod
    def read(cls, bridge: Path, recorders: Mapping[str, Path]) -> DemoAccount:
        """Read the logs of the bridge and of the recorders.

        Parameters
        ----------
        bridge
            Log file of the bridge.
        recorders
            Log file of each recorder, by the name of the recorded motion.

        Raises
        ------
        ValueError
            If a log does not contain the expected last line.
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
        """Yield the lines that the demo prints at its end, the warnings last."""
        yield f'Bridge    {self.cycles}'
        for name, text in self.messages.items():
            yield f'Recorder  {name}: {text}'
        if self.too_slow:
            yield (
                'NOTE      this computer was too slow for real time. The results are valid, '
                f'because the simulation waited. For a real arm, {_ADVICE}'
            )
        if any(self.lost.values()):
            lost = sum(filter(None, self.lost.values()))
            yield f'WARNING   {lost} messages are missing from the bags: {_ADVICE}'


def _count(text: str) -> int | None:
    return None if text == 'unknown' else int(text)


def _last(pattern: re.Pattern[str], log: Path) -> re.Match[str]:
    found = list(pattern.finditer(log.read_text(errors='replace')))
    if not found:
        raise ValueError(
            f'no line of the log {log} matches {pattern.pattern!r}: check why the process ended '
            'early'
        )
    return found[-1]


# Time limits [s], long because a slow or busy computer loads and simulates slowly.
_START_TIME = 120
_STEP_TIME = 300.0


class DemoError(RuntimeError):
    """Error for a failed step of the demo; the message names the step and its log file."""


@dataclass(frozen=True)
class Motion:
    """One recorded motion: name, description, parameters of the node `excitation`, and bag."""

    name: str
    what: str
    trajectory: Mapping[str, object]
    bag: Path


class DemoRun:
    """Run the nodes of the demo one after the other.

    Parameters
    ----------
    out
        Output folder, which contains an empty folder `logs`.
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
        """Move the emulated arm and record both motions; return the nodes' last log lines.

        Raises
        ------
        DemoError, ArmClientError
            If a node fails, or the arm does not perform the motion.
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
            print('Arm       the emulated boards start', flush=True)
            _wait_for_bridge(hardware, client)
            print('Arm       the joints home: they turn to their index pulses', flush=True)
            client.call('home')
            client.wait_for_mode(['ready'], _STEP_TIME)
            for motion in self._motions:
                self._run_motion(motion)
        if hardware.returncode != 0:
            raise _failed(hardware)
        try:
            return DemoAccount.read(
                self._logs / 'fake_hardware.log',
                {motion.name: self._recorder_log(motion) for motion in self._motions},
            )
        except ValueError as error:
            raise DemoError(str(error)) from None

    def identify(self) -> None:
        """Identify the model, and check its consistency and accuracy.

        Raises
        ------
        DemoError
            If the model is not physically consistent, or its torque error exceeds half the torque
            error of the CAD model.
        """
        (identification, validation), out = self._motions, self._out
        arguments = ['--bag', str(identification.bag), '--validation', str(validation.bag)]
        arguments += ['--truth', str(out / 'truth.yaml'), '--out', str(out / 'result')]
        with NodeProcess('identifier', arguments) as identifier:
            _wait(identifier, 2 * _STEP_TIME)
        solvers = json.loads((out / 'result' / 'summary.json').read_text())['solvers']
        if not solvers['sdp']['physically_consistent']:
            raise DemoError(
                f'the identified model is not physically consistent: check {out}/result/report.html'
            )
        cad, identified = (solvers[name]['validation'][0]['filtered'] for name in ('cad', 'sdp'))
        if identified > 0.5 * cad:
            raise DemoError(
                f'the torque error of the identified model ({identified:.1f} %) exceeds half the '
                f'torque error of the CAD model ({cad:.1f} %): check {out}/result/report.html'
            )

    def _run_motion(self, motion: Motion) -> None:
        options = self._options
        with ExitStack() as stack:
            recorder = stack.enter_context(
                NodeProcess(
                    'recorder', parameters={'bag': motion.bag}, log=self._recorder_log(motion)
                )
            )
            print(f'Motion    {motion.name} ({motion.what})', flush=True)
            # Two nodes that start at the same time can delay each other by seconds. Meanwhile the
            # recorder would miss messages.
            _wait_for_recorder(recorder)
            excitation = stack.enter_context(
                NodeProcess(
                    'excitation',
                    parameters={
                        **motion.trajectory,
                        'periods': options.periods,
                        'subscribers': 2,
                        'wait_for_recorder': True,
                        'wait_timeout': _STEP_TIME,
                        'realtime_priority': max(0, options.priority - 1),
                    },
                )
            )
            _wait(excitation, _STEP_TIME * (2 + options.periods))
            if recorder.returncode is not None:
                raise _failed(recorder)
        if recorder.returncode != 0:
            raise _failed(recorder)

    def _recorder_log(self, motion: Motion) -> Path:
        return self._logs / f'recorder_{motion.name}.log'


def _failed(process: NodeProcess) -> DemoError:
    """Return the error for a process that has ended too early or with an error."""
    return DemoError(
        f'the node {process.name} ended with exit status {process.returncode}; end of its log:\n'
        f'{process.tail()}'
    )


def _wait_for_bridge(hardware: NodeProcess, client: ArmClient) -> None:
    for _ in range(_START_TIME):
        try:
            return client.wait_for_mode(OFF, timeout=1.0)
        except ArmClientError:
            if hardware.returncode is not None:
                raise _failed(hardware) from None
    raise DemoError(
        f'the node fake_hardware was not ready within {_START_TIME} s: check {hardware.log}'
    )


def _wait_for_recorder(recorder: NodeProcess) -> None:
    deadline = time.monotonic() + _STEP_TIME
    while 'publishers found' not in recorder.tail():
        if recorder.returncode is not None:
            raise _failed(recorder)
        if time.monotonic() > deadline:
            raise DemoError(
                f'the recorder was not ready within {_STEP_TIME:g} s: check {recorder.log}'
            )
        time.sleep(0.05)


def _arm_client() -> ArmClient:
    use_packaged_profile()
    find_log_directory()
    # Ctrl-C and SIGTERM raise KeyboardInterrupt in the demo, while the context is still valid.
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('demo')
    # Destroying the node may take long, so the demo prints its table first.
    atexit.register(_leave, node)
    return ArmClient(node, ['fake_hardware'])


def _leave(node: Node) -> None:
    node.destroy_node()
    rclpy.try_shutdown()


def _wait(process: NodeProcess, timeout: float) -> None:
    """Wait for the end of a process; raises DemoError if it fails or exceeds `timeout` [s]."""
    try:
        status = process.wait(timeout)
    except TimeoutExpired:
        raise DemoError(
            f'the process {process.name} did not end within {timeout:g} s: check the messages above'
        ) from None
    if status != 0:
        raise DemoError(
            f'the process {process.name} ended with exit status {status}: check the messages above'
        )
