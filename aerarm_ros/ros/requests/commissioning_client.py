"""Client that runs the guided commissioning procedure on a bridge, in a terminal."""

from __future__ import annotations

import argparse
import os
import secrets
import select
import sys
import time
from datetime import datetime
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_ros.commissioning.commissioning import Commissioning, Prompt
from aerarm_ros.commissioning.commissioning_record import (
    CommissioningRecord,
    load_record,
    record_path,
)
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.boards.commissioning_probe import OFF, WATCH, ProbeReport, ProbeRequest
from aerarm_ros.ros.executors import spin_until, this_domain
from aerarm_ros.ros.process.process_end import print_notice
from aerarm_ros.ros.requests.arm_client import ArmClientError

_PERIOD = 0.05  # [s] between two requests
_SILENCE = 10.0  # [s] without a report, after which the bridge counts as ended
_LAST = 4  # final requests, because a single one may be lost
_STILL = 0.01  # [rad] largest motion of a resting motor between two reports, on the motor side
_STILL_REPORTS = 10


class EmulatedPerson:
    """Turn the joints of emulated boards and confirm the prompts, as a person does on a real arm.

    Parameters
    ----------
    node
        Owner of the parameter client.
    run
        Commissioning run whose prompts are answered.
    bridge
        Node of the emulated boards, with the parameter `hand`.
    """

    def __init__(self, node: Node, run: CommissioningRun, bridge: str) -> None:
        self._run = run
        self._parameters = AsyncParameterClient(node, bridge)
        self._prompt: Prompt | None = None
        self._future: Future | None = None
        self._last: ProbeReport | None = None
        self._still = 0

    def poll(self) -> None:
        """Turn a joint, or confirm a prompt; call this method once after each request of the run.

        Raises ValueError if the parameter `hand` is rejected.
        """
        prompt, report = self._run.prompt, self._run.report
        if prompt is None or self._run.guided is None:
            return
        if prompt is not self._prompt:
            self._prompt, self._still = prompt, 0
            self._future = None
            if prompt.hand is not None:
                name, angle = prompt.hand
                hand = Parameter('hand', value=f'{name}:{angle:.6f}')
                self._future = self._parameters.set_parameters([hand])
        if self._future is not None:
            if not self._future.done():
                return
            result = self._future.result().results[0]
            if not result.successful:
                raise ValueError(result.reason)
            if not self._rests(report):
                return
        self._run.guided.answer(True)

    def _rests(self, report: ProbeReport | None) -> bool:
        """Return whether all motors have been at rest in the last ten reports."""
        if report is None or report is self._last:
            return False
        last, self._last = self._last, report
        ways = zip(report.travel, last.travel if last else (), strict=False)
        moves = last is None or any(abs(new - old) > _STILL for new, old in ways)
        self._still = 0 if moves else self._still + 1
        return self._still >= _STILL_REPORTS


_SPIN = 0.02  # [s]
_ANSWERS = '[y: done, n: skip this step, Ctrl-C: stop and switch the motors off]'


class CommissioningRun:
    """Run a `Commissioning` procedure on a bridge: print prompts and findings, read answers.

    Parameters
    ----------
    node
        Node without executor.
    options
        Options of `arm commission`.

    Attributes
    ----------
    guided
        The commissioning procedure, None before its begin.
    report
        Newest report of the bridge, None before the first.
    """

    def __init__(self, node: Node, options: argparse.Namespace) -> None:
        self.guided: Commissioning | None = None
        self.report: ProbeReport | None = None
        self._node, self._options = node, options
        self._source = Path(options.config or resource('config', 'aerarm.yaml'))
        self._config = load_arm_config(options.config or None)
        self._name = secrets.token_hex(4)
        self._sent = self._received_at = -_PERIOD
        self._prefix = ''
        self._saved: CommissioningRecord | None = None
        self._person = EmulatedPerson(node, self, options.bridge) if options.yes else None
        self._typed = ''
        self._asked: object = None
        self._printed = 0
        self._publisher = topics.COMMISSIONING_REQUEST.publisher(node)
        topics.COMMISSIONING_REPORT.subscription(node, self._on_report)

    @property
    def prompt(self) -> Prompt | None:
        """Commissioning prompt that the user must answer now, or None."""
        return None if self.guided is None else self.guided.prompt

    @property
    def _path(self) -> Path:
        """Path of the file with the commissioning record."""
        emulated = self.report is not None and self.report.emulated
        return Path(self._options.record or record_path(self._source, emulated))

    def run(self) -> None:
        """Run the commissioning procedure, then switch the motors off, even after an error.

        Raises
        ------
        ArmClientError
            If no bridge runs, the bridge stops answering, or a joint does not pass.
        """
        try:
            self._begin(self._find_bridge())
            self._lead()
        except ValueError as error:
            raise ArmClientError(str(error)) from None
        finally:
            self._end()
        assert self.guided is not None
        record = self.guided.record.joints
        failed = [name for name, entry in record.items() if not entry.passed]
        if failed:
            option = f' --record {self._options.record}' if self._options.record else ''
            raise ArmClientError(
                f'{", ".join(failed)} did not pass: read the findings in {self._path}, correct '
                'their causes, then commission these joints again with '
                f"'arm commission --resume{option}'"
            )
        print(f'passed: {", ".join(record)}; record: {self._path}', flush=True)

    def _find_bridge(self) -> ProbeReport:
        def report() -> ProbeReport | None:
            self._poll()
            return self.report

        if not spin_until(self._node, report, self._options.timeout) or self.report is None:
            raise ValueError(
                'no bridge answers on the topic commissioning_report: check that a bridge is '
                f'active in {this_domain()}'
            )
        if self._person is not None and not self.report.emulated:
            raise ValueError(
                '--yes is for emulated boards only, because on a real arm a person must turn the '
                'joints and check that the arm can move freely: remove --yes'
            )
        return self.report

    def _begin(self, report: ProbeReport) -> None:
        """Start the procedure for the joints that the options name; raise ValueError if invalid."""
        joints, own = self._options.joint, self._config.joint_names
        self._prefix = report.joints[0].removesuffix(own[0])
        config = self._config.with_prefix(self._prefix)
        if config.joint_names != report.joints:
            raise ValueError(
                f'the bridge has joints {", ".join(report.joints)}, but {self._source} has '
                f'{", ".join(own)}: select the same configuration as the bridge, with --config'
            )
        robot = load_robot(
            self._options.urdf or None,
            gravity_in_base=config.gravity_in_base,
            joint_names=own,
            prefix=self._prefix,
        )
        record = self._known_record(report.emulated)
        unknown = [name for name in joints if name not in own]
        if unknown:
            raise ValueError(f'unknown joint {", ".join(unknown)}: choose from {", ".join(own)}')
        left = record.open_joints(self._config) if self._options.resume else range(len(own))
        chosen = [i for i in left if not joints or own[i] in joints]
        if not chosen:
            raise ValueError(
                f'every selected joint has already passed: see the record {self._path}'
            )
        self._saved = record.with_prefix(self._prefix)
        self._received_at = time.monotonic()
        self.guided = Commissioning(config, robot, self._saved, chosen, self._name)

    def _lead(self) -> None:
        guided = self.guided
        assert guided is not None
        while not guided.is_done:
            rclpy.spin_once(self._node, timeout_sec=_SPIN)
            self._poll()
            self._print_news()
            if time.monotonic() - self._received_at > _SILENCE and not guided.is_done:
                raise ArmClientError('the bridge no longer responds: check the log of the bridge')
            if self._person is not None:
                self._person.poll()
            else:
                self._read_answer()
        self._poll()  # an answer may have ended the last joint
        self._print_news()

    def _poll(self) -> None:
        """Send the present request to the bridge, process its newest report, and save the record.

        Raises OSError if the record cannot be saved.
        """
        now = time.monotonic()
        if now - self._sent >= _PERIOD:
            self._sent = now
            watch = ProbeRequest(f'{self._name}:begin', WATCH)
            self._send(self.guided.request if self.guided else watch)
        guided, report = self.guided, self.report
        if guided is None or report is None:
            return
        guided.update(datetime.now().astimezone(), report)
        if guided.record is not self._saved:
            self._saved = guided.record
            self._saved.without_prefix(self._prefix).save(self._path)

    def _end(self) -> None:
        """Switch the motors off; joints that have passed stay in the record."""
        if self.guided is not None:
            self.guided.end()
        for _ in range(_LAST):
            self._send(ProbeRequest(f'{self._name}:end', OFF))
            time.sleep(_PERIOD)

    def _known_record(self, emulated: bool) -> CommissioningRecord:
        fresh = CommissioningRecord(self._config.name, emulated)
        record = load_record(self._path) if self._path.exists() else fresh
        if (record.arm, record.emulated) != (fresh.arm, fresh.emulated):
            kind = 'an emulated' if record.emulated else 'the real'
            raise ValueError(
                f'{self._path} contains the commissioning record of {kind} arm {record.arm}: '
                'select another file with --record'
            )
        return record

    def _send(self, request: ProbeRequest) -> None:
        self._publisher.publish(String(data=request.text()))

    def _on_report(self, message: String) -> None:
        try:
            report = ProbeReport.parse(message.data)
        except ValueError:
            return
        if report.id.partition(':')[0] == self._name:
            self._received_at = time.monotonic()
            self.report = report

    def _print_news(self) -> None:
        """Print new findings and results, and a new prompt."""
        assert self.guided is not None
        news, prompt = self.guided.news, self.prompt
        for line in news[self._printed :]:
            print(line, flush=True)
        self._printed = len(news)
        if prompt is not None and prompt is not self._asked:
            self._asked = prompt
            print(f'  {prompt.text} {_ANSWERS}', flush=True)

    def _read_answer(self) -> None:
        """Answer the prompt with a typed line; raise ArmClientError if the terminal was closed."""
        guided = self.guided
        if guided is None or self.prompt is None:
            return
        if '\n' not in self._typed and select.select([sys.stdin], [], [], 0.0)[0]:
            read = os.read(sys.stdin.fileno(), 256).decode(errors='replace')
            if not read:
                raise ArmClientError(
                    'the terminal was closed, so commissioning has stopped and the motors are '
                    "off: continue with 'arm commission --resume'"
                )
            self._typed += read
        line, newline, rest = self._typed.partition('\n')
        if not newline:
            return
        # One line per prompt: a line typed in advance answers the next prompt.
        self._typed = rest
        answer = line.strip().lower()
        if answer in ('y', 'yes', 'n', 'no'):
            guided.answer(answer.startswith('y'))
        else:
            print_notice('arm', f'{answer!r} is not a valid answer: type y or n')
