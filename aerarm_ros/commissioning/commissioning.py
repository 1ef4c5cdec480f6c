"""Guided commissioning procedure, joint by joint and step by step."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.commissioning.commissioning_record import CommissioningRecord, JointRecord
from aerarm_ros.description.arm_config import ArmConfig, DriveTrain
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.boards.commissioning_probe import (
    DRIVE,
    OFF,
    REACH,
    SPEED,
    WATCH,
    ProbeReport,
    ProbeRequest,
)
from aerarm_ros.model.kinematics import Kinematics

RATIO_TOLERANCE = 0.05
_NOT_TURNED = 0.2  # smallest fraction of a joint's turn that its encoder must count
_ALSO_TURNED = 0.25  # another joint may move by this fraction of the turn
_PULSES_OFF = 2
_RETURN_TOLERANCE = 0.05  # [rad] difference between two placements of the joint by hand
_NOT_DRIVEN = 0.5  # smallest fraction of the requested travel that the driven joint must reach
_DELIVERED = (0.8, 1.2)
# Friction of a real gear relative to the configured one: 30 % spread, and running-in of printed
# gears. The allowance applies to joints with almost no friction.
_FRICTION = (0.3, 2.0)
_FRICTION_ALLOWANCE = 0.05  # [Nm]
_REVOLUTION = 2.0 * pi

Findings = list[str]
Measured = dict[str, float]


def turn_findings(
    config: ArmConfig, joint: int, turn: float, report: ProbeReport
) -> tuple[Findings, Measured]:
    """Evaluate the bridge's report on a joint that a person turned with the motors off.

    Parameters
    ----------
    config
        Configuration of the arm.
    joint
        Number of the joint.
    turn
        Angle by which the person turned the joint [rad], positive in the joint's direction.
    report
        Report of the bridge that covers the whole turn.

    Returns
    -------
    findings
        Problems, each with what to check; empty for a joint that matches its configuration.
    measured
        `reduction`: motor turns per joint turn.
    """
    this, names = config.joints[joint], config.joint_names
    gears = config.column('gear.ratio').tolist()
    turned = [gear * abs(span) / abs(turn) for gear, span in zip(gears, report.span, strict=True)]
    most = max(range(config.n), key=turned.__getitem__)
    if turned[most] < _NOT_TURNED:
        return [
            f'{this.name}: no encoder counted the turn; check that you turned the right joint, '
            f'the encoder cable, and the magnet of {this.motor.name}'
        ], {}
    if most != joint:
        other = config.joints[most]
        return [
            f'{this.name}: when this joint turned, the encoder of {other.name} counted. Swap the '
            'cables of the two joints, or swap their board and channel in the configuration '
            f'({this.name}: {this.board}, {this.channel}; {other.name}: {other.board}, '
            f'{other.channel})'
        ], {}
    carried = [name for i, name in enumerate(names) if i != joint and turned[i] > _ALSO_TURNED]
    reduction, expected = abs(report.travel[joint] / turn), 1.0 / this.gear.ratio
    off = reduction / expected - 1.0
    pulses, counted = report.span[joint] / _REVOLUTION, report.pulses[joint]
    checks = (
        (
            bool(carried),
            f'{", ".join(carried)} turned as well; repeat the turn, and hold all other joints '
            'still',
        ),
        (
            report.travel[joint] * turn * this.sign < 0.0,
            'the encoder counts in the opposite direction to the configuration; set sign: '
            f'{-this.sign}',
        ),
        (
            abs(off) > RATIO_TOLERANCE,
            f'the motor makes {reduction:.2f} turns per turn of the joint, but the configuration '
            f'states {expected:.4g} ({100.0 * off:+.0f} %); correct the gear ratio, or turn the '
            'joint by the requested angle',
        ),
        (
            abs(counted - pulses) > _PULSES_OFF,
            f'the encoder reported {counted} index pulses in {pulses:.1f} motor turns; check the '
            "encoder's index line",
        ),
    )
    return _failed(this.name, checks), {'reduction': reduction}


def _failed(name: str, checks: Iterable[tuple[bool, str]]) -> Findings:
    """Return the finding of each failed check of a joint, with the name of the joint."""
    return [f'{name}: {finding}' for has_failed, finding in checks if has_failed]


def return_findings(config: ArmConfig, joint: int, report: ProbeReport) -> Findings:
    """Return the problems found after a person turned a joint back to its home configuration."""
    this = config.joints[joint]
    off = this.gear.ratio * report.travel[joint]
    if abs(off) <= _RETURN_TOLERANCE:
        return []
    return [
        f'{this.name}: after the return to the home configuration, the encoder angle is off by '
        f'{off:+.3f} rad; place the joint exactly, or check the encoder for lost counts and the '
        'gear for slip'
    ]


def drive_findings(config: ArmConfig, joint: int, report: ProbeReport) -> tuple[Findings, Measured]:
    """Evaluate the bridge's report on a joint that its motor turned back and forth.

    Returns
    -------
    findings
        Problems, each with what to check.
    measured
        `delivered`: ratio of measured to requested current. `friction` and `load`: half the
        difference and half the sum of the joint torques in positive and negative direction [Nm].
    """
    this = config.joints[joint]
    if report.phase != 'done' or len(report.strokes) != 2:
        return [
            f'{this.name}: the bridge did not drive the motor ({report.reason or report.phase})'
        ], {}
    gears = config.column('gear.ratio').tolist()
    way = [gear * span / (2.0 * REACH) for gear, span in zip(gears, report.span, strict=True)]
    others = [
        name for i, name in enumerate(config.joint_names) if i != joint and way[i] > _NOT_DRIVEN
    ]
    up, down = report.strokes
    effort = this.torque_per_ampere
    if way[joint] < _NOT_DRIVEN:
        moved = (
            f'{", ".join(others)} moved instead: check the channels of the boards'
            if others
            else f'the joint did not move at {effort * report.current_max:.2f} Nm. Possible '
            'causes: too much friction, an open motor phase, or an object that holds the joint'
        )
        return [f'{this.name}: the motor did not move the joint; {moved}'], {}
    requested, delivered = up.requested - down.requested, up.measured - down.measured
    friction, expected = 0.5 * effort * delivered, this.coulomb + this.viscous * SPEED
    measured = {'friction': friction, 'load': 0.5 * effort * (up.measured + down.measured)}
    if requested > 0.0:
        measured['delivered'] = delivered / requested
    share = measured.get('delivered', 0.0)
    low, high = (factor * expected for factor in _FRICTION)
    what = 'joint for rubbing parts' if friction > expected else 'coupling of the gear to the motor'
    checks = (
        (bool(others), f'{", ".join(others)} moved as well; check the motor phases'),
        (
            min(up.speed, -down.speed) < 0.5 * SPEED,
            f'the joint moved at {up.speed:+.2f} and {down.speed:+.2f} rad/s instead of {SPEED:+g} '
            f'and {-SPEED:+g} rad/s; check the direction of the motor',
        ),
        (
            not _DELIVERED[0] <= share <= _DELIVERED[1],
            f'the driver delivers {100.0 * share:.0f} % of the requested current; check the supply '
            "voltage, the motor phases, and the board's current measurement",
        ),
        (
            not low - _FRICTION_ALLOWANCE <= friction <= high + _FRICTION_ALLOWANCE,
            f'the measured friction is {friction:.3f} Nm, but the configuration states '
            f'{expected:.3f} Nm; check the {what}, and check the configured torque constant and '
            'gear ratio',
        ),
    )
    return _failed(this.name, checks), measured


def pulse_offset(
    config: ArmConfig, joint: int, home_angle: float, report: ProbeReport
) -> float | None:
    """Return the motor angle at the index pulses, modulo a turn [rad]; None without a pulse.

    Parameters
    ----------
    home_angle
        Motor angle at the start of the report [rad], relative to the configured offset.
    """
    angle = report.pulse_angle[joint]
    return None if angle is None else (home_angle + angle) % _REVOLUTION


_SKIPPED = 'skipped by the user'
_NO_PULSE = (
    'homing needs the angle of the index pulse, but the bridge located no index pulse between two '
    'consecutive frames. Turn the joint slowly, check the load of this computer, and repeat'
)
_TURN = 0.5 * np.pi  # [rad] angle by which a person turns a joint, measured with a set square
_TURN_MIN = 0.5
_LIMIT_MARGIN = 0.05  # [rad] minimum distance between the turned joint and its position limit
_TOOL_MOVES = 0.02  # [m/rad] larger tool motions describe the direction of a joint to the person


@dataclass(frozen=True)
class Prompt:
    """Instruction to a person, which the person confirms.

    Attributes
    ----------
    text
        Instruction; the person answers yes when it is done, or no to skip the step.
    hand
        Joint name and target angle [rad] for a turn by hand; None for no turn.
    """

    text: str
    hand: tuple[str, float] | None = None


def turn_prompts(config: ArmConfig, robot: Robot, joint: int) -> list[Prompt]:
    """Return the three prompts by which a person turns a joint by a known angle and back."""
    name, home = config.joint_names[joint], config.rest_position[joint]
    turn = _turn(config, joint)
    return [
        Prompt(
            f'Motors are off. Put {name} at its home configuration, {home:.4g} rad, as exactly as '
            'you can.',
            (name, home),
        ),
        Prompt(
            f'Turn {name} by {np.degrees(turn):+.0f} degrees, to {home + turn:.4g} rad, within 3 '
            f'degrees, and keep it at that angle: {_direction(config, robot, joint, turn)}.',
            (name, home + turn),
        ),
        Prompt(f'Turn {name} back to {home:.4g} rad.', (name, home)),
    ]


def _turn(config: ArmConfig, joint: int) -> float:
    """Return the angle by which a person turns a joint from its home configuration [rad]."""
    this, home = config.joints[joint], config.rest_position[joint]
    up, down = this.position_max - home - _LIMIT_MARGIN, home - this.position_min - _LIMIT_MARGIN
    free = up if up >= min(_TURN, down) else -down
    turn = float(np.clip(free, -_TURN, _TURN))
    if abs(turn) < _TURN_MIN:
        raise ValueError(
            f'{this.name} can turn only {abs(turn):.2f} rad from its home configuration, but '
            f'commissioning needs {_TURN_MIN:g} rad: choose another rest_position'
        )
    return turn


def _direction(config: ArmConfig, robot: Robot, joint: int, turn: float) -> str:
    """Return a text on the direction of a joint's turn from the home configuration."""
    try:
        tool = Kinematics(robot)
    except ValueError:  # the arm has no frame of that name
        tool = Kinematics(robot, robot.link_names[-1])
    speed = np.sign(turn) * tool.jacobian(np.array(config.rest_position))[:, joint]
    if np.linalg.norm(speed[:3]) > _TOOL_MOVES:
        return f'the tool starts to move along the base axis {_axis(speed[:3])}'
    axis = _axis(speed[3:])
    return f'counter-clockwise, seen from the tip of the base axis {axis}'


def _axis(vector: NDArray[np.float64]) -> str:
    """Return the base axis nearest to a vector, for example '+x'."""
    along = int(np.argmax(np.abs(vector)))
    return f'{"+" if vector[along] > 0.0 else "-"}{"xyz"[along]}'


# Findings and measured values of a step, and whether its findings make further steps of the joint
# useless. The step yields a prompt to receive the person's answer, or None to receive a report.
_Step = Generator[Prompt | None, Any, tuple[Findings, Measured, bool]]


class Commissioning:
    """Guided first power-on of an arm, independent of user interface and transport.

    The client shows `prompt` and passes on the answer, repeats `request` to the bridge, and calls
    `update` with the bridge's reports.

    Parameters
    ----------
    config, robot
        Configuration and robot model, with joint names as on the topics.
    record
        Earlier results; the entries of joints that are not commissioned are kept.
    joints
        Numbers of the joints to commission, in the order of their commissioning.
    client
        Unique name by which the bridge distinguishes this client.

    Raises
    ------
    ValueError
        If a joint cannot be turned far enough.

    Attributes
    ----------
    record
        Record with the results of all joints finished so far.
    news
        Lines to print for the person, in order: started joints, findings and results.
    prompt
        Instruction that the person must confirm; None while the bridge works.
    is_done
        Whether all joints are finished, or the client has ended the procedure.
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
        self.prompt: Prompt | None = None
        self.is_done = False
        self._config, self._robot, self._client = config, robot, client
        for joint in joints:
            _turn(config, joint)  # raises ValueError if the joint cannot turn
        self._name, self._kind, self._number = '', WATCH, 0
        self._now = datetime.now().astimezone()
        self._procedure = self._run(joints)
        self._continue(None)

    @property
    def request(self) -> ProbeRequest:
        """Current request to the bridge; the client sends this request at 10 Hz or more."""
        if self.is_done:
            return ProbeRequest(f'{self._client}:end', OFF)
        return ProbeRequest(f'{self._client}:{self._number}', self._kind, self._name)

    def answer(self, yes: bool) -> None:
        """Process a person's answer to the prompt."""
        if self.prompt is not None:
            self._continue(yes)

    def update(self, now: datetime, report: ProbeReport) -> None:
        """Process a report of the bridge; reports on earlier requests are ignored."""
        self._now = now
        if self.prompt is None and not self.is_done and report.id == self.request.id:
            self._continue(report)

    def end(self) -> None:
        """End the procedure without a result for the current joint, and stop the bridge."""
        self.is_done, self.prompt = True, None

    def _continue(self, received: bool | ProbeReport | None) -> None:
        """Continue the procedure until it needs the next answer or report."""
        try:
            self.prompt = self._procedure.send(received)
        except StopIteration:
            self.end()

    def _run(self, joints: Sequence[int]) -> Generator[Prompt | None, Any, None]:
        for joint in joints:
            self._name = self._config.joint_names[joint]
            self.news.append(f'{self._name}:')
            findings: Findings = []
            measured: Measured = {}
            for step in (self._check_board, self._turn_by_hand, self._drive):
                self._request(WATCH)
                found, values, is_fatal = yield from step(joint)
                self.news += found
                findings += found
                measured |= values
                if is_fatal:
                    break
            self._finish(joint, findings, measured)

    def _request(self, kind: str) -> None:
        """Make the bridge start an action, even if it is the same action again."""
        self._kind, self._number = kind, self._number + 1

    def _check_board(self, joint: int) -> _Step:
        """Check whether the joint's board answers."""
        report = yield None
        if report.phase != 'watching':
            problem = report.reason or f'the bridge is {report.mode}'
        else:
            problem = report.boards[joint]
        if not problem and report.mode == 'fault':
            problem = "the bridge is in fault: see its log, then 'arm clear_fault'"
        return _failed(self._name, [(bool(problem), problem)]), {}, bool(problem)

    def _turn_by_hand(self, joint: int) -> _Step:
        """Let a person turn the joint by a known angle and back while all motors are off.

        The turn identifies the encoder's channel, its direction, the gear ratio, and the angles of
        its index pulses.
        """
        config, findings, measured = self._config, Findings(), Measured()
        for number, prompt in enumerate(turn_prompts(config, self._robot, joint)):
            if not (yield prompt):
                return [*findings, f'{self._name}: {_SKIPPED}'], measured, False
            if number == 0:
                self._request(WATCH)  # the bridge restarts its count at the present angle
            report = yield None
            if report.phase != 'watching':
                reason = report.reason or 'the bridge stopped to watch'
                return [*findings, f'{self._name}: {reason}'], measured, True
            if number == 1:
                findings, measured = turn_findings(config, joint, _turn(config, joint), report)
                if not measured:  # another motor's encoder moved: the gear ratio is undetermined
                    return findings, measured, True
                home = DriveTrain(config).joint_to_motor_position(np.array(config.rest_position))
                offset = pulse_offset(config, joint, float(home[joint]), report)
                if offset is not None:
                    measured['pulse_offset'] = offset
                elif not findings:
                    findings = [f'{self._name}: {_NO_PULSE}']
        return findings + return_findings(config, joint, report), measured, False

    def _drive(self, joint: int) -> _Step:
        """Let the motor turn its joint back and forth at low torque and speed."""
        is_confirmed = yield Prompt(
            f'The motor of {self._name} aligns its rotor now, then turns the joint by {REACH:g} '
            'rad to both sides. A second person must hold the weight of the arm. Keep all hands '
            f'away from {self._name}: THE ARM MOVES. Drive the motor?'
        )
        if not is_confirmed:
            return [f'{self._name}: {_SKIPPED}'], {}, False
        self._request(DRIVE)
        report = yield None
        while report.phase not in ('done', 'failed'):
            report = yield None
        return *drive_findings(self._config, joint, report), False

    def _finish(self, joint: int, findings: Findings, measured: Measured) -> None:
        name, now = self._name, self._now
        entry = JointRecord.of(self._config.joints[joint], now, findings, measured)
        self.record = replace(self.record, date=now, joints={**self.record.joints, name: entry})
        values = ', '.join(f'{key} {value:.4g}' for key, value in entry.measured.items())
        verdict = 'passed' if entry.passed else 'NOT passed'
        self.news.append(f'{name} {verdict}{": " if values else ""}{values}')
