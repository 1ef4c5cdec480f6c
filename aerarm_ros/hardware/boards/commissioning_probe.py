"""Bridge side of commissioning: measures motors that a person turns, and drives one motor.

A client repeats its request until the step has ended. A lost message therefore has no effect,
and a motor stops if its client stops.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import inf, isfinite, pi
from typing import Any

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.board_link import ArmMeasurements, BoardLink
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.gate.joint_barrier import JointLoads

WATCH, DRIVE, OFF = KINDS = ('watch', 'drive', 'off')
_LONGEST = 64  # characters of a name
# characters of a request, limited because the node that reads it has other tasks
_LONGEST_REQUEST = 1024


@dataclass(frozen=True)
class ProbeRequest:
    """Request to the bridge to run a step of the commissioning procedure.

    Attributes
    ----------
    id
        Name of the client and number of the request, for example 'a1b2:3'. A repeated id
        continues the running request.
    kind
        'watch' measures the rotation of motors that are off, starting with the first request.
        'drive' turns one motor back and forth. 'off' ends watching and driving.
    joint
        Name of the joint to drive.
    """

    id: str
    kind: str
    joint: str = ''

    @property
    def client(self) -> str:
        """Name of the commissioning client that sent the request."""
        return self.id.partition(':')[0]

    def text(self) -> str:
        """Return this commissioning request as JSON text."""
        return json.dumps(asdict(self))

    @classmethod
    def parse(cls, text: str) -> ProbeRequest:
        """Parse a commissioning request; raise ValueError with the reason if it is invalid."""
        if len(text) > _LONGEST_REQUEST:
            raise ValueError(f'a commissioning request of {len(text)} characters is too long')
        fields = _object(text)
        values = [fields.get(key, '') for key in ('id', 'kind', 'joint')]
        if not all(isinstance(value, str) and len(value) <= _LONGEST for value in values):
            raise ValueError('id, kind and joint of a commissioning request must be short strings')
        request = cls(*values)
        if not request.client or request.kind not in KINDS:
            raise ValueError(
                f'a commissioning request needs an id and one of the kinds {", ".join(KINDS)}'
            )
        return request


@dataclass(frozen=True)
class Stroke:
    """Mean current and speed of the driven motor in one direction of its joint.

    Attributes
    ----------
    requested, measured
        Current requested by the board's control law, and measured current [A]. Positive currents
        turn the joint to larger angles if the configured sign is right.
    speed
        Joint speed computed with the configured gear ratio [rad/s].
    """

    requested: float
    measured: float
    speed: float


@dataclass(frozen=True)
class ProbeReport:
    """The bridge's answer to a commissioning request; arrays have one value per joint.

    Attributes
    ----------
    id
        Id of the answered request.
    phase
        'off', 'watching', 'aligning', 'driving', 'done' or 'failed'.
    reason
        Reason of a failure.
    mode
        Mode of the arm.
    joints
        Names of the joints.
    boards
        Problem of each joint's board, '' if the board answers.
    travel, span
        Change of each motor's angle since the request began, and difference of its largest and
        smallest angle [rad].
    pulses
        Number of index pulses since the request began.
    pulse_angle
        Mean motor angle at these pulses, measured like `travel` and modulo a motor turn [rad];
        None without a pulse.
    strokes
        Mean values of a finished drive, in positive and in negative direction of the joint.
    current_max
        Largest current that a drive may request [A].
    emulated
        Whether the boards are emulated.
    """

    id: str
    phase: str
    reason: str
    mode: str
    joints: tuple[str, ...]
    boards: tuple[str, ...]
    travel: tuple[float, ...]
    span: tuple[float, ...]
    pulses: tuple[int, ...]
    pulse_angle: tuple[float | None, ...]
    strokes: tuple[Stroke, ...] = ()
    current_max: float = 0.0
    emulated: bool = False

    def text(self) -> str:
        """Return this commissioning report as JSON text."""
        return json.dumps(asdict(self))

    @classmethod
    def parse(cls, text: str) -> ProbeReport:
        """Parse a commissioning report; raise ValueError with the reason if it is invalid."""
        fields = _object(text)
        try:
            strokes = tuple(Stroke(**stroke) for stroke in fields.pop('strokes'))
            lists: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value
                for key, value in fields.items()
            }
            report = cls(strokes=strokes, **lists)
            arrays = (report.boards, report.travel, report.span, report.pulses, report.pulse_angle)
            n = len(report.joints)
            if not all(isinstance(array, tuple) and len(array) == n for array in arrays):
                raise ValueError('an array of the report does not have one value per joint')
            angles = (angle for angle in report.pulse_angle if angle is not None)
            by_stroke = (number for stroke in strokes for number in vars(stroke).values())
            numbers = (*report.travel, *report.span, *report.pulses, *angles, *by_stroke)
            if not all(map(isfinite, (*numbers, report.current_max))):
                raise ValueError('a number in the report is not finite')
            texts = (report.id, report.phase, report.reason, report.mode, *report.joints)
            if not all(isinstance(text, str) for text in (*texts, *report.boards)):
                raise ValueError('a name or reason in the report is not a string')
        except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
            raise ValueError(f'not a commissioning report: {error}') from None
        return report


def _object(text: str) -> dict[str, Any]:
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise ValueError('a commissioning message must be a JSON object')
    return fields


SPEED = 0.15  # [rad/s] speed of a driven joint, as in homing
REACH = 0.12  # [rad] travel of a driven joint to either side of its initial angle
_SILENCE = 1.0  # [s] without a request after which a drive ends
# [s] without a request after which watching ends; longer than for a drive, because all motors are
# off and a client on a busy host may be late
_WATCH_SILENCE = 10.0
# Torque limit of a drive: several times the configured friction, plus the gravity torque of an
# arm that is tilted by more than the reach. Smaller currents than 0.5 A are too coarse in a
# frame.
_FRICTION_FACTOR = 3.0
_LOAD_SHARE = 0.15
_CURRENT_MIN = 0.5  # [A]
# A drive ends above this speed, because a motor whose torque has the wrong sign accelerates.
_SPEED_FACTOR = 4.0
_TRAVEL_FACTOR = 2.0
_CURRENT_FACTOR = 2.0
# modes of the bridge in which motors are driven
_ON = ('aligning', 'ready', 'homing', 'running', 'damping')
_AT_REST = 0.05  # [rad/s] largest speed of a joint before its motor is switched on
_BLURRED = 3e-3  # [s] longest time between two frames for which the angle of a pulse is known
_SETTLING = 0.3  # [s] time of a stroke before averaging begins
# Direction and duration [s] of each part of a drive; direction 1 moves by the reach.
_STROKE = REACH / SPEED
_PARTS = (
    (0, _SETTLING),
    (1, _STROKE),
    (0, 0.2),
    (-1, 2.0 * _STROKE),
    (0, 0.2),
    (1, _STROKE),
    (0, 0.1),
)


class CommissioningProbe:
    """Checks the wiring and signs of motors, encoders and joints, at low torque and speed.

    No encoder zero is needed. In the watch phase all motors are off, and the probe counts the
    rotation and the index pulses of each motor. In the drive phase one motor is on and all others
    are off: the motor aligns, then turns its joint by 0.12 rad to either side at 0.15 rad/s.

    At the end of every drive, also after a failure, the motor is switched off and not damped,
    because damping would accelerate a motor whose encoder has the wrong sign. A drive fails if
    the client is silent for 1 s, on a board fault, on an emergency stop, and if current, speed or
    travel exceed their limits.

    Parameters
    ----------
    links, state, references
        Links to the boards, measurements of the boards, and motor references.
    loads
        Largest gravity torques of the joints.
    problem
        Function that returns why no motor may be switched on, '' if allowed; see
        `FaultWatch.refusal`.
    """

    def __init__(
        self,
        config: ArmConfig,
        links: Sequence[BoardLink],
        state: ArmMeasurements,
        references: MotorReferences,
        loads: JointLoads,
        problem: Callable[[bool], str],
    ) -> None:
        self._config = config
        self._links = tuple(links)
        self._state = state
        self._references = references
        self._problem = problem
        self._now = -inf
        self._joint = 0
        self._id = ''
        self._phase, self._reason = 'off', ''
        self._contact = -inf
        effort = _FRICTION_FACTOR * config.column('coulomb') + _LOAD_SHARE * loads.load_max
        effort = np.minimum(effort, config.column('effort_max'))
        current = np.maximum(effort / config.column('torque_per_ampere'), _CURRENT_MIN)
        self._current_max: list[float] = current.tolist()
        self._reduction: list[float] = (1.0 / config.column('gear.ratio')).tolist()
        self._count = _TravelCount(state)
        self._drive = _Drive(0.0)
        # Reference of the joint that was active when the board measured [rad], [rad/s].
        self._sent = self._next = (0.0, 0.0)

    @property
    def is_driving(self) -> bool:
        """Whether commissioning aligns or drives a motor at present."""
        return self._phase in ('aligning', 'driving')

    @property
    def refusal(self) -> str:
        """Reason to reject requests that switch motors on while one is driven; otherwise ''."""
        name = self._config.joint_names[self._joint]
        return f'{name} is being commissioned: end that procedure first' if self.is_driving else ''

    def ask(self, request: ProbeRequest, mode: str) -> ProbeReport:
        """Process a commissioning request and return a report; call between two cycles.

        Parameters
        ----------
        request
            Request of a client; the id of the running request continues it.
        mode
            Mode of the arm.
        """
        if self.is_driving and request.client != self._id.partition(':')[0]:
            return self._report(request.id, 'failed', f'{self.refusal} (by another client)', mode)
        self._contact = self._now
        if request.id != self._id:
            self.end('')
            self._id, self._reason = request.id, ''
            is_on = mode in _ON
            problem = f'the arm is {mode}: disable the arm first' if is_on else self._problem(False)
            self._begin(request, problem)
        return self._report(self._id, self._phase, self._reason, mode)

    def end(self, reason: str) -> None:
        """End the commissioning step: stop counting, or switch the driven motor off."""
        if self.is_driving:
            self._links[self._config.joints[self._joint].board].drive_only(None)
            self._phase, self._reason = 'failed', reason
        elif self._phase == 'watching':
            self._phase = 'off'

    def drive(self, now: float, stop: str) -> BoardLink | None:
        """Set the driven motor's reference and return its board's link; None if none is driven.

        Parameters
        ----------
        now
            Time [s].
        stop
            Reason of a latched stop, '' if there is none.
        """
        if not self.is_driving:
            return None
        if stop or now - self._contact > _SILENCE:
            self.end(stop or f'no request for {_SILENCE:g} s: the client has stopped')
            return None
        motor = self._references.motors[self._joint]
        joint = self._config.joints[self._joint]
        motor.current_max = self._current_max[self._joint]
        motor.kp, motor.kd = joint.board_kp, joint.board_kd
        # Keep the present position until the motor is aligned.
        motor.position = float(self._state.reported_position[self._joint])
        if self._phase == 'driving':
            slope = joint.sign * self._reduction[self._joint]
            offset, speed = self._drive.reference(now)
            reach = motor.current_max / motor.kp if motor.kp else 0.0
            wanted = self._drive.start + slope * offset
            motor.position = min(max(wanted, motor.position - reach), motor.position + reach)
            motor.velocity = slope * speed
        self._sent, self._next = self._next, (motor.position, motor.velocity)
        return self._links[joint.board]

    def look(self, now: float) -> None:
        """Update the commissioning step from the boards' last answers; call once per cycle."""
        self._now = now
        if self._phase == 'watching':
            self._count.look()
            if now - self._contact > _WATCH_SILENCE:
                self._phase = 'off'
        elif self.is_driving:
            self._count.look()
            self._look_at_drive(now)

    def _begin(self, request: ProbeRequest, problem: str) -> None:
        self._phase = {WATCH: 'watching', DRIVE: 'aligning', OFF: 'off'}[request.kind]
        self._drive = _Drive(0.0)
        self._count = _TravelCount(self._state)
        if request.kind != DRIVE:
            return
        names = self._config.joint_names
        if not problem and request.joint not in names:
            problem = f'unknown joint {request.joint}: the arm has {", ".join(names)}'
        moving = np.abs(self._state.dq) > _AT_REST
        if not problem and moving.any():
            name = names[int(np.argmax(moving))]
            problem = f'{name} moves: hold the arm and wait until it rests'
        if problem:
            self._phase, self._reason = 'failed', problem
            return
        self._joint = names.index(request.joint)
        joint = self._config.joints[self._joint]
        self._links[joint.board].drive_only(joint.channel)

    def _look_at_drive(self, now: float) -> None:
        state, i = self._state, self._joint
        joint = self._config.joints[i]
        position, velocity = float(state.reported_position[i]), float(state.motor_velocity[i])
        if self._phase == 'aligning':
            if self._links[joint.board].is_aligned:
                self._phase, self._drive = 'driving', _Drive(position, now)
            return
        current = float(state.motor_current[i])
        speed = velocity / self._reduction[i]
        travel = (position - self._drive.start) / self._reduction[i]
        if abs(speed) > _SPEED_FACTOR * SPEED:
            self.end(
                f'{joint.name} moved at {abs(speed):.2f} rad/s instead of {SPEED:g}, so its motor '
                'turns against its encoder: check the motor phases and the channel'
            )
        elif abs(travel) > _TRAVEL_FACTOR * REACH:
            self.end(f'{joint.name} was turned by {abs(travel):.2f} rad instead of {REACH:g}')
        elif abs(current) > _CURRENT_FACTOR * self._current_max[i]:
            self.end(
                f'the motor of {joint.name} had {abs(current):.1f} A, above the limit of '
                f'{self._current_max[i]:.1f} A: check the current measurement of the board'
            )
        elif self._drive.is_over(now):
            self._links[joint.board].drive_only(None)
            self._phase = 'done'
        else:
            motor = self._references.motors[i]
            sent_position, sent_velocity = self._sent
            asked = motor.kp * (sent_position - position) + motor.kd * (sent_velocity - velocity)
            most = self._current_max[i]
            asked = min(max(asked, -most), most)
            self._drive.add(now, joint.sign * asked, joint.sign * current, joint.sign * speed)

    def _report(self, id_: str, phase: str, reason: str, mode: str) -> ProbeReport:
        names, count = self._config.joint_names, self._count
        by_board = [_board_problem(link) for link in self._links]
        return ProbeReport(
            id=id_,
            phase=phase,
            reason=reason,
            mode=mode,
            joints=names,
            boards=tuple(by_board[joint.board] for joint in self._config.joints),
            travel=tuple(count.travel.tolist()),
            span=tuple((count.highest - count.lowest).tolist()),
            pulses=tuple(count.pulses.tolist()),
            pulse_angle=tuple(count.pulse_angle(i) for i in range(len(names))),
            strokes=self._drive.strokes() if phase == 'done' else (),
            current_max=self._current_max[self._joint],
        )


def _board_problem(link: BoardLink) -> str:
    monitor = link.monitor
    if monitor.is_silent or not monitor.is_connected:
        return f'{monitor.name} does not answer: {monitor.problem}'
    return monitor.fault


class _TravelCount:
    """Rotation and index pulses of each motor since the commissioning request began, (n,) each."""

    def __init__(self, state: ArmMeasurements) -> None:
        self._state = state
        self._start = self._last = state.reported_position.copy()
        self._toggles = state.index_toggle.copy()
        self.travel, self.lowest, self.highest = np.zeros((3, len(self._start)))
        self.pulses = np.zeros(len(self._start), int)
        # sum of the angles of the pulses, as complex numbers of length 1
        self._directions = np.zeros(len(self._start), complex)

    def look(self) -> None:
        state = self._state
        position, toggles = state.reported_position.copy(), state.index_toggle.copy()
        # NaN until a board has answered
        is_new, is_known = np.isnan(self._start), np.isfinite(position)
        self._start = np.where(is_new, position, self._start)
        self._last = np.where(is_new, position, self._last)
        self._toggles = np.where(is_new, toggles, self._toggles)
        self.travel = np.where(is_known, position - self._start, 0.0)
        self.lowest = np.minimum(self.lowest, self.travel)
        self.highest = np.maximum(self.highest, self.travel)
        toggled = is_known & (toggles != self._toggles)
        self.pulses += toggled
        sharp = toggled & (np.array(state.interval) < _BLURRED)
        angle = 0.5 * (position + self._last) - self._start
        self._directions[sharp] += np.exp(1j * angle[sharp])
        self._last, self._toggles = position, toggles

    def pulse_angle(self, joint: int) -> float | None:
        """Return the mean motor angle [rad] of index pulses modulo a turn; None without a pulse."""
        direction = self._directions[joint]
        return float(np.angle(direction)) % (2.0 * pi) if direction else None


class _Drive:
    """Reference of a motor that turns its joint back and forth, and means of the measurements."""

    def __init__(self, start: float, begin: float = inf) -> None:
        self.start = start
        self._begin = begin
        self._sums = {1: [0.0] * 4, -1: [0.0] * 4}

    def reference(self, now: float) -> tuple[float, float]:
        """Return the joint's reference: displacement from the start [rad] and speed [rad/s]."""
        direction, since, offset = self._part(now)
        return offset + direction * SPEED * since, direction * SPEED

    def is_over(self, now: float) -> bool:
        return now - self._begin > sum(duration for _, duration in _PARTS)

    def add(self, now: float, *values: float) -> None:
        """Add a sample: requested current [A], measured current [A] and joint speed [rad/s]."""
        direction, since, _ = self._part(now)
        if direction and since > _SETTLING:
            sums = self._sums[direction]
            for i, value in enumerate((1.0, *values)):
                sums[i] += value

    def strokes(self) -> tuple[Stroke, ...]:
        """Return the mean measurements of the positive and of the negative direction of motion."""
        return tuple(
            Stroke(*(value / max(count, 1.0) for value in values))
            for count, *values in (self._sums[1], self._sums[-1])
        )

    def _part(self, now: float) -> tuple[int, float, float]:
        """Return direction, elapsed time [s] and start displacement [rad] of the present move."""
        left, offset = now - self._begin, 0.0
        for direction, duration in _PARTS:
            if left <= duration:
                return direction, max(left, 0.0), offset
            left -= duration
            offset += direction * SPEED * duration
        return 0, 0.0, offset
