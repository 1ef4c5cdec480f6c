"""The guided procedure: one joint after the other, one step after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime

from aerarm_ros.commissioning.commissioning_record import CommissioningRecord, JointRecord
from aerarm_ros.commissioning.commissioning_step import (
    BoardStep,
    CommissioningStep,
    DriveStep,
    Prompt,
    TurnStep,
)
from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.boards.probe_messages import OFF, ProbeReport, ProbeRequest

_STEPS = (BoardStep, TurnStep, DriveStep)


class Commissioning:
    """Leads a person through the first power-on of an arm, without any input or output of its own.

    The client shows `prompt` and takes the answer, sends `request` to the bridge again and
    again, and calls `update` with the bridge's reports.

    Parameters
    ----------
    config, robot
        The arm as drawn, by the names of its topics.
    record
        What is known already; joints of other numbers keep their entries.
    joints
        Numbers of the joints to commission, in turn.
    client
        Name that no other client has, for the bridge.

    Raises
    ------
    ValueError
        If a joint has no room to be turned.

    Attributes
    ----------
    record
        With the results so far.
    news
        Lines for the person, in order: joints begun, findings, results.
    """

    def __init__(
        self,
        config: ArmConfig,
        robot: Robot,
        record: CommissioningRecord,
        joints: Sequence[int],
        client: str,
    ) -> None:
        self.record = record
        self.news: list[str] = []
        self._config = config
        self._client = client
        self._steps: list[tuple[int, list[CommissioningStep]]] = [
            (joint, [make(config, robot, joint) for make in _STEPS]) for joint in joints
        ]
        self._at = 0
        self._done: list[CommissioningStep] = []
        self._is_ended = False
        self._begin_joint()

    @property
    def is_done(self) -> bool:
        """Whether every joint was looked at, or it was ended."""
        return self._is_ended or not self._steps

    @property
    def prompt(self) -> Prompt | None:
        """What a person has to confirm, None while the bridge is waited for."""
        step = self._step
        return None if step is None else step.prompt

    @property
    def request(self) -> ProbeRequest:
        """What the bridge shall do now; to be repeated ten times a second or more."""
        step = self._step
        if step is None:
            return ProbeRequest(f'{self._client}:end', OFF)
        name = self._config.joint_names[self._steps[0][0]]
        return ProbeRequest(f'{self._client}:{self._at}.{step.number}', step.kind, name)

    def answer(self, yes: bool) -> None:
        """Take a person's answer to the prompt."""
        step = self._step
        if step is not None and step.prompt is not None:
            step.answer(yes)
            self._go_on()

    def update(self, now: datetime, report: ProbeReport) -> None:
        """Take a report of the bridge, at a date; others than on the last request are ignored."""
        step = self._step
        if step is None or report.id != self.request.id:
            return
        step.update(report)
        self._go_on(now)

    def end(self) -> None:
        """Stop here: the joint that is under way gets no entry, the bridge is asked for OFF."""
        self._is_ended = True

    @property
    def _step(self) -> CommissioningStep | None:
        return None if self.is_done else self._steps[0][1][0]

    def _begin_joint(self) -> None:
        if self._steps:
            self._done = []
            self.news.append(f'{self._config.joint_names[self._steps[0][0]]}:')

    def _go_on(self, now: datetime | None = None) -> None:
        step = self._step
        if step is None or not step.is_done:
            return
        joint, steps = self._steps[0]
        steps.pop(0)
        self._at += 1
        self._done.append(step)
        self.news += step.findings
        if steps and not step.is_fatal:
            return
        self._finish(joint, now or datetime.now().astimezone())
        self._steps.pop(0)
        self._begin_joint()

    def _finish(self, joint: int, now: datetime) -> None:
        findings = [finding for step in self._done for finding in step.findings]
        measured = {key: value for step in self._done for key, value in step.measured.items()}
        entry = JointRecord.of(self._config.joints[joint], now, findings, measured)
        name = self._config.joint_names[joint]
        self.record = replace(self.record, date=now, joints={**self.record.joints, name: entry})
        values = ', '.join(f'{key} {value:.4g}' for key, value in entry.measured.items())
        verdict = 'passed' if entry.passed else 'NOT passed'
        self.news.append(f'{name} {verdict}{": " if values else ""}{values}')
