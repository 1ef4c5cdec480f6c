"""`demo`: move the emulated arm, record its motion, identify a model, and check the accuracy."""

from __future__ import annotations

import argparse
import atexit
import json
import re
import time
from collections.abc import Callable, Mapping
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


# Time limits [s], long because a slow or busy computer loads and simulates slowly.
_START_TIME = 120.0
_STEP_TIME = 300.0


class DemoError(RuntimeError):
    """Error for a failed step of the demo; the message names the step and its log file."""


def account_lines(bridge: Path, recorders: Mapping[str, Path]) -> list[str]:
    """Return the lines that the demo prints at its end, the warnings last.

    Parameters
    ----------
    bridge
        Log file of the bridge, whose last line contains the number of cycles.
    recorders
        Log file of each recorder, by the name of the recorded motion. Its last line contains the
        number of lost messages, or 'unknown' if the middleware does not number messages.

    Raises
    ------
    DemoError
        If a log does not contain the expected last line.
    """
    cycles = _last(_CYCLES, bridge)
    messages = {name: _last(_MESSAGES, log) for name, log in recorders.items()}
    lines = [f'Bridge    {cycles[0]}']
    lines += [f'Recorder  {name}: {found[0]}' for name, found in messages.items()]
    if cycles['slow']:
        lines.append(
            'NOTE      this computer was too slow for real time. The results are valid, because '
            f'the simulation waited. For a real arm, {_ADVICE}'
        )
    lost = sum(int(found['lost']) for found in messages.values() if found['lost'] != 'unknown')
    if lost:
        lines.append(f'WARNING   {lost} messages are missing from the bags: {_ADVICE}')
    return lines


def _last(pattern: re.Pattern[str], log: Path) -> re.Match[str]:
    found = list(pattern.finditer(log.read_text(errors='replace')))
    if not found:
        raise DemoError(
            f'no line of the log {log} matches {pattern.pattern!r}: check why the process ended '
            'early'
        )
    return found[-1]


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
        self._options = options
        # Description and parameters of the node `excitation`, by the name of the motion.
        self._motions: dict[str, tuple[str, Mapping[str, object]]] = {
            'identification': (
                'designed', {'trajectory': resource('config', 'designed_motion.yaml')}
            ),
            'validation': (f'random, seed {options.seed}', {'seed': options.seed}),
        }  # fmt: skip

    def move_and_record(self) -> list[str]:
        """Move the emulated arm and record both motions; return lines about the nodes' logs.

        Raises
        ------
        DemoError, ArmClientError
            If a node fails, or the arm does not perform the motion.
        """
        log = self._log('fake_hardware')
        parameters = {
            'seed': self._options.arm_seed,
            'pace': self._options.pace,
            'truth_file': self._out / 'truth.yaml',
            'realtime_priority': self._options.priority,
        }
        with NodeProcess('fake_hardware', parameters=parameters, log=log) as hardware:
            client = _arm_client()
            print('Arm       the emulated boards start', flush=True)
            _wait_until_ready(hardware, lambda: _is_switched_off(client), _START_TIME)
            print('Arm       the joints home: they turn to their index pulses', flush=True)
            client.call('home')
            client.wait_for_mode(['ready'], _STEP_TIME)
            for name in self._motions:
                self._run_motion(name)
        if hardware.returncode != 0:
            raise _failed(hardware)
        return account_lines(log, {name: self._log(f'recorder_{name}') for name in self._motions})

    def identify(self) -> None:
        """Identify the model, and check its consistency and accuracy.

        Raises
        ------
        DemoError
            If the model is not physically consistent, or its torque error exceeds half the torque
            error of the CAD model.
        """
        out = self._out
        files = {
            '--bag': 'identification_bag',
            '--validation': 'validation_bag',
            '--truth': 'truth.yaml',
            '--out': 'result',
        }
        arguments = [text for option, name in files.items() for text in (option, str(out / name))]
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

    def _run_motion(self, name: str) -> None:
        options, (what, trajectory) = self._options, self._motions[name]
        bag = {'bag': self._out / f'{name}_bag'}
        with NodeProcess('recorder', parameters=bag, log=self._log(f'recorder_{name}')) as recorder:
            print(f'Motion    {name} ({what})', flush=True)
            # Two nodes that start at the same time can delay each other by seconds. Meanwhile the
            # recorder would miss messages.
            _wait_until_ready(recorder, lambda: 'publishers found' in recorder.tail(), _STEP_TIME)
            parameters = {
                **trajectory,
                'periods': options.periods,
                'wait_for_recorder': True,
                'wait_timeout': _STEP_TIME,
                'realtime_priority': max(0, options.priority - 1),
            }
            with NodeProcess('excitation', parameters=parameters) as excitation:
                _wait(excitation, _STEP_TIME * (2 + options.periods))
                if recorder.returncode is not None:
                    raise _failed(recorder)
        if recorder.returncode != 0:
            raise _failed(recorder)

    def _log(self, name: str) -> Path:
        return self._out / 'logs' / f'{name}.log'


def _failed(process: NodeProcess) -> DemoError:
    """Return the error for a process that has ended too early or with an error."""
    return DemoError(
        f'the node {process.name} ended with exit status {process.returncode}; end of its log:\n'
        f'{process.tail()}'
    )


def _is_switched_off(client: ArmClient) -> bool:
    try:
        client.wait_for_mode(OFF, timeout=1.0)
    except ArmClientError:
        return False
    return True


def _wait_until_ready(process: NodeProcess, is_ready: Callable[[], bool], limit: float) -> None:
    deadline = time.monotonic() + limit
    while not is_ready():
        if process.returncode is not None:
            raise _failed(process)
        if time.monotonic() > deadline:
            raise DemoError(
                f'the node {process.name} was not ready within {limit:g} s: check {process.log}'
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
