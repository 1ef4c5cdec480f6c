"""Emulated boards on a simulated arm, in step with the caller's time."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedMotor
from aerarm_ros.motion.signals import Array
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant

_LAG_MAX = 20  # states; beyond it a command would be too old to be let in anyway


class AnswerWatch:
    """Follows which state was answered last, and says whether the next must wait for an answer.

    A controller stamps a command with the stamp of the state that it answers. Once one does, it is
    expected to go on, each answer at most `lag` states behind. Who does not within the patience of
    whoever waits is given up, until its next answer, and with a larger lag from then on: it may
    answer every tenth state only. A command with a stamp of its own is no answer, and nobody waits
    for the next.

    Parameters
    ----------
    period_ns
        From state to state [ns].
    lag
        Number of states that may be without an answer.
    """

    def __init__(self, period_ns: int, lag: int) -> None:
        self._period_ns = period_ns
        self._lag = self._first_lag = lag
        self._answered_ns = 0
        self._expects = False

    @property
    def expects(self) -> bool:
        """Whether a node responds to states."""
        return self._expects

    def note(self, stamp_ns: int, newest_ns: int) -> None:
        """Take note of a command with a stamp, while the newest state has another [ns]."""
        self._expects = self.is_answer(stamp_ns, newest_ns)
        self._answered_ns = stamp_ns

    def is_answer(self, stamp_ns: int, newest_ns: int) -> bool:
        """Whether a stamp [ns] is that of the newest state, or of one not long before."""
        states, rest = divmod(newest_ns - stamp_ns, self._period_ns)
        return 0 <= states <= _LAG_MAX and rest == 0

    def awaits(self, newest_ns: int) -> bool:
        """Whether the answer to the state of this stamp [ns], or one shortly before, is due."""
        return self._expects and newest_ns - self._answered_ns > self._lag * self._period_ns

    def give_up(self) -> None:
        """Stop waiting until the next response, and wait a shorter time from then on."""
        self._expects = False
        self._lag = min(4 * self._lag + 1, _LAG_MAX)

    def forget(self) -> None:
        """Reset: no node commands the arm."""
        self._expects = False
        self._lag = self._first_lag


_SPEED = 0.6  # [rad/s]
_STIFFNESS = 150.0  # [Nm/rad]
_DAMPING = 3.0  # [Nms/rad]
_STRENGTH = 12.0  # [Nm] at most
_ERROR = 0.01  # [rad] a hand places a joint against a mark or a set square so well
_SETTLING = 0.5  # [s]


def parse_turn(text: str, names: Sequence[str]) -> tuple[int, float]:
    """Read JOINT:ANGLE and return the joint's number and the angle [rad].

    Parameters
    ----------
    text
        As a user writes it.
    names
        Joints of the arm; a prefix that they share may be left out.

    Raises
    ------
    ValueError
        If there is no such joint, or the angle is not a number.
    """
    name, _, number = text.strip().rpartition(':')
    joints = [i for i, known in enumerate(names) if name and known.endswith(name)]
    try:
        angle = float(number)
    except ValueError:
        joints = []
    if len(joints) != 1 or not isfinite(angle):
        listed = ', '.join(names)
        raise ValueError(
            f'{text!r} must be JOINT:ANGLE with one of the joints {listed} and an angle [rad]'
        )
    return joints[0], angle


class EmulatedHand:
    """Turns a joint slowly to an angle, misses it a little, and lets go.

    Parameters
    ----------
    joint
        Number of the joint.
    start, target
        Angles [rad] where the joint is and where it shall be.
    seed
        Of the error of placement.
    """

    def __init__(self, joint: int, start: float, target: float, seed: int = 0) -> None:
        self.joint = joint
        miss = float(np.random.default_rng([seed, joint]).uniform(-_ERROR, _ERROR))
        self._reference = start
        self._target = target + miss
        self._left = self.duration = abs(self._target - start) / _SPEED + _SETTLING

    @property
    def is_done(self) -> bool:
        """Whether the joint has been let go."""
        return self._left <= 0.0

    def effort(self, q: float, dq: float, duration: float) -> float:
        """Return the torque [Nm] on the joint at q [rad], dq [rad/s], and go on for a time [s]."""
        self._left -= duration
        step = _SPEED * duration
        away = self._target - self._reference
        self._reference += min(max(away, -step), step)
        effort = _STIFFNESS * (self._reference - q) - _DAMPING * dq
        return min(max(effort, -_STRENGTH), _STRENGTH)


_CATCH_UP = 0.010  # [s] most that one call simulates
_RELEASE_TIME = 0.5  # [s] in which whoever carries the arm lets it go


class EmulatedTransport:
    """A `Transport` whose boards drive an `ArmPlant`.

    `advance(now)` runs boards and arm in whole sub-steps up to `now`. After a gap of more
    than 10 ms simulated time slips by the rest, so that a host that was late neither bursts
    to catch up nor lets the boards' time-outs strike for it. It may run ahead of the next
    exchange, as real boards do beside the host: `advance` to an earlier time then does nothing.

    A real arm is carried by hand until its motors hold it, because the alignment of
    unpowered motors cannot lift it. So is this one: its weight is carried at first, and let
    go within 0.5 s once every motor is ready. `carry` takes it up again where it is,
    `put_back` where it started, `put_at_rest` in its home configuration.

    Parameters
    ----------
    boards
        One for each of the configuration's boards.
    plant
        The arm.
    config
        Connects joints to boards, and gives signs, offsets and gear ratios.
    """

    def __init__(self, boards: Sequence[EmulatedBoard], plant: ArmPlant, config: ArmConfig) -> None:
        self.boards = tuple(boards)
        self.plant = plant
        self.slipped = 0.0
        self._config = config
        self._seed = plant.parameters.seed or 0
        self._angles = [[0.0, 0.0] for _ in self.boards]
        self._hand: EmulatedHand | None = None
        self._connect()
        for board in self.boards:
            board.rewire = self._rewire
        self._start = plant.position
        self._rest: Array = np.array(config.rest_position)
        self._now: float | None = None
        self.carry()

    def _connect(self) -> None:
        """Connect joints to boards as the configuration and the boards' wiring say."""
        # What each joint turns: where its motor's angle goes, the motor, its gear and its zero.
        self._drives: list[tuple[list[float], int, EmulatedMotor, float, float]] = []
        self._effort_per_current: list[float] = []
        constants = self.plant.parameters.motor_torque_constant.tolist()
        for joint, torque_constant in zip(self._config.joints, constants, strict=True):
            board = self.boards[joint.board]
            wiring, at = board.wiring, joint.channel
            reduction = wiring.reduction[at] or 1.0 / joint.gear.ratio
            ratio = joint.sign * wiring.direction[at] * reduction
            channel = 1 - at if wiring.swapped else at
            angles = self._angles[joint.board]
            self._drives.append((angles, channel, board.motors[channel], ratio, joint.offset))
            self._effort_per_current.append(torque_constant * joint.gear.efficiency * ratio)

    def _rewire(self) -> None:
        """Adopt the boards' wiring; encoders continue from their counts."""
        self._connect()
        for (_, _, motor, ratio, offset), q in zip(
            self._drives, self.plant.position.tolist(), strict=True
        ):
            motor.encoder.remount((q - offset) * ratio)
        for board in self.boards:
            for motor, delivery in zip(board.motors, board.wiring.delivery, strict=True):
                motor.delivery = delivery
        friction = [
            self.boards[joint.board].wiring.friction[joint.channel] for joint in self._config.joints
        ]
        self.plant.scale_friction(friction)

    def turn(self, joint: int, angle: float) -> float:
        """Let a hand turn a joint to an angle [rad] while its motors are off.

        It carries the weight of the arm, from now on. Returns how long it will take [s]; raises
        ValueError if a motor is driven or the angle is beyond what a hand can reach.
        """
        if any(board.system_enabled for board in self.boards):
            raise ValueError('the motors are driven: disable the arm first')
        limits = self._config.joints[joint]
        if not limits.position_min <= angle <= limits.position_max:
            raise ValueError(
                f'{limits.name} can turn from {limits.position_min:g} to {limits.position_max:g} '
                f'rad, not to {angle:g}'
            )
        if not self._carried:
            self.carry()
        self._hand = EmulatedHand(joint, float(self.plant.position[joint]), angle, self._seed)
        return self._hand.duration

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nothing to close."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Pass a frame to an emulated board and return its answer."""
        return self.boards[board].exchange(frame)

    def exchange_time(self, board: int) -> float:
        """Duration that the emulated bus claims for an exchange [s]."""
        return self.boards[board].faults.exchange_time

    def exchanged_at(self, board: int) -> float:
        """When the last exchange with a board was [s]: the time to which the boards have run."""
        return self._now or 0.0

    def problem(self, board: int) -> str:
        """Emulated wires never break: the boards' faults are seen in the frames."""
        return ''

    @property
    def is_carried(self) -> bool:
        """Whether the arm's weight is carried by hand."""
        return self._carried

    def carry(self) -> None:
        """Stop the arm by hand and carry its weight until every motor is ready."""
        self.plant.reset(self.plant.position)
        self._carried = True
        self.plant.support = 1.0
        for _, _, motor, _, _ in self._drives:
            motor.encoder.velocity = 0.0
        for board in self.boards:
            board.prepare()  # the frame made before tells of a moving arm

    def put_back(self) -> None:
        """Take the arm back to where it started, and carry it: what to do before enabling again."""
        self._put(self._start)

    def put_at_rest(self) -> None:
        """Take the arm to its home configuration, and carry it: what to do before homing."""
        self._put(self._rest)

    def _put(self, target: Array) -> None:
        self.plant.restart(target)
        positions = target.tolist()
        for (_, _, motor, ratio, offset), q in zip(self._drives, positions, strict=True):
            motor.encoder.place((q - offset) * ratio)
        self.carry()

    def advance(self, now: float) -> None:
        """Run boards and arm up to `now` [s], or 10 ms at most."""
        if self._now is None or now < self._now - _CATCH_UP:
            self._now = now
        late = now - self._now - _CATCH_UP
        if late > 0.0:
            self.slipped += late
            self._now += late
        steps = max(0, int((now - self._now) / SUBSTEP + 1e-6))
        self._now += steps * SUBSTEP
        if steps and self.plant.support > 0.0:
            self._let_go(steps * SUBSTEP)
        for _ in range(steps):
            self._step()
        if steps:
            for board in self.boards:
                board.prepare()

    def _step(self) -> None:
        drives = self._drives
        positions = self.plant.position.tolist()
        for (angles, channel, _, ratio, offset), q in zip(drives, positions, strict=True):
            angles[channel] = (q - offset) * ratio
        for board, (first, second) in zip(self.boards, self._angles, strict=True):
            board.step(first, second)
        gains = self._effort_per_current
        effort = [gain * drive[2].torque_current for gain, drive in zip(gains, drives, strict=True)]
        if self._hand is not None:
            self._push(self._hand, positions, effort)
        self.plant.apply_effort(effort)
        self.plant.step()

    def _push(self, hand: EmulatedHand, positions: list[float], effort: list[float]) -> None:
        i = hand.joint
        effort[i] += hand.effort(positions[i], float(self.plant.velocity[i]), SUBSTEP)
        if hand.is_done:
            self._hand = None

    def _let_go(self, duration: float) -> None:
        if self._carried:
            motors = [motor for _, _, motor, _, _ in self._drives]
            self._carried = not all(motor.ready and motor.enabled for motor in motors)
        else:
            self.plant.support -= duration / _RELEASE_TIME
