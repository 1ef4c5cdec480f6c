"""Transport to emulated boards and a simulated arm, which advance with the bridge's time."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedMotor
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.motion.signals import Array
from aerarm_ros.simulation.arm_plant import SUBSTEP, ArmPlant

_LAG_MAX = 20  # [states] with a larger lag the bridge would reject the command as too old


class AnswerWatch:
    """Decides whether the simulation waits for a controller's answer to a joint state.

    A controller stamps a command with the stamp of the state that it answers. After the first
    answer, every further answer is expected at most `lag` states later. If an answer does not
    arrive in time, waiting stops until the controller answers again. From then on a larger lag is
    allowed, because a controller may answer only every tenth state. A command whose stamp is not
    that of a state is not an answer, so no answer is waited for.

    Parameters
    ----------
    period_ns
        Time between two states [ns].
    lag
        Number of the newest states that may remain unanswered.

    Attributes
    ----------
    expects
        Whether a controller answers the joint states at present.
    """

    def __init__(self, period_ns: int, lag: int) -> None:
        self._period_ns = period_ns
        self._lag = self._first_lag = lag
        self._answered_ns = 0
        self.expects = False

    def note(self, stamp_ns: int, newest_ns: int) -> None:
        """Record the stamps [ns] of a received command and of the newest joint state."""
        self.expects = self.is_answer(stamp_ns, newest_ns)
        self._answered_ns = stamp_ns

    def is_answer(self, stamp_ns: int, newest_ns: int) -> bool:
        """Whether a command's stamp [ns] equals that of the newest or a recent joint state."""
        states, rest = divmod(newest_ns - stamp_ns, self._period_ns)
        return 0 <= states <= _LAG_MAX and rest == 0

    def awaits(self, newest_ns: int) -> bool:
        """Whether the simulation must wait for a command before the next joint state."""
        return self.expects and newest_ns - self._answered_ns > self._lag * self._period_ns

    def give_up(self) -> None:
        """Stop waiting until the controller answers again; then tolerate a larger lag."""
        self.expects = False
        self._lag = min(4 * self._lag + 1, _LAG_MAX)

    def forget(self) -> None:
        """Discard all answers and reset the tolerated lag, as no controller is left."""
        self.expects = False
        self._lag = self._first_lag


_SPEED = 0.6  # [rad/s] speed at which the emulated hand turns a joint
_STIFFNESS = 150.0  # [Nm/rad]
_DAMPING = 3.0  # [Nms/rad]
_STRENGTH = 12.0  # [Nm] largest torque of a hand
_ERROR = 0.01  # [rad] placement error of a hand against a mark or a set square
_SETTLING = 0.5  # [s]


def parse_turn(text: str, names: Sequence[str]) -> tuple[int, float]:
    """Parse JOINT:ANGLE; return the joint's number and the angle [rad].

    Parameters
    ----------
    text
        Text as typed by the user.
    names
        Joint names of the arm; the user may omit their common prefix.

    Raises
    ------
    ValueError
        If the joint is unknown, or the angle is not a number.
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
    """Emulated hand that turns a joint slowly to about an angle, then releases the joint.

    Parameters
    ----------
    start, target
        Initial and final angle [rad].
    seed
        Seed of the placement error.
    """

    def __init__(self, joint: int, start: float, target: float, seed: int = 0) -> None:
        self.joint = joint
        miss = float(np.random.default_rng([seed, joint]).uniform(-_ERROR, _ERROR))
        self._reference = start
        self._target = target + miss
        self._left = self.duration = abs(self._target - start) / _SPEED + _SETTLING

    @property
    def is_done(self) -> bool:
        """Whether the emulated hand has released the joint."""
        return self._left <= 0.0

    def effort(self, q: float, dq: float, duration: float) -> float:
        """Return the hand's torque [Nm] at q [rad] and dq [rad/s]; advance by `duration` [s]."""
        self._left -= duration
        step = _SPEED * duration
        away = self._target - self._reference
        self._reference += min(max(away, -step), step)
        effort = _STIFFNESS * (self._reference - q) - _DAMPING * dq
        return min(max(effort, -_STRENGTH), _STRENGTH)


_CATCH_UP = 0.010  # [s] longest simulated time per call
_RELEASE_TIME = 0.5  # [s] time in which the person who carries the arm releases it


class EmulatedTransport:
    """Transport to emulated boards, whose motors drive a simulated arm (`ArmPlant`).

    `advance(now)` simulates boards and arm in whole sub-steps up to `now`. If `now` is more than
    10 ms later than the simulation, only 10 ms are simulated, so that a delayed host causes
    neither a long computation nor time-outs of the boards. If `now` is earlier than the
    simulation, nothing happens.

    A person carries a real arm during the alignment of its motors, which cannot hold the arm yet.
    Likewise, the weight of the simulated arm is supported at first, and released within 0.5 s
    once every motor is ready. `carry` supports the arm in its present posture, `put_back` moves
    it to its initial posture, and `put_at_rest` to its home configuration.

    Parameters
    ----------
    boards
        Emulated boards, one per board of the configuration.
    plant
        Simulation of the arm.
    config
        Connections of joints to boards, signs, offsets and gear ratios.

    Attributes
    ----------
    is_carried
        Whether an emulated hand supports the arm's weight.
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
        """Connect joints to board channels, as the configuration and the wiring errors specify."""
        # For each joint: the list that receives the motor angle, the index in this list, the
        # motor, its gear ratio and its zero.
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
        """Apply changed wiring errors of the boards, without a change of encoder counts."""
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
        """Turn a joint by hand to an angle [rad] while its motors are off.

        From this call on, the arm's weight is supported by hand. Returns the duration of the
        motion [s]; raises ValueError if a motor is driven or a hand cannot reach the angle.
        """
        if any(board.system_enabled for board in self.boards):
            raise ValueError('the motors are driven: disable the arm first')
        limits = self._config.joints[joint]
        if not limits.position_min <= angle <= limits.position_max:
            raise ValueError(
                f'{limits.name} can turn from {limits.position_min:g} to {limits.position_max:g} '
                f'rad, not to {angle:g}'
            )
        if not self.is_carried:
            self.carry()
        self._hand = EmulatedHand(joint, float(self.plant.position[joint]), angle, self._seed)
        return self._hand.duration

    def open(self) -> None:
        """Do nothing; emulated boards need no device."""

    def close(self) -> None:
        """Do nothing; emulated boards need no device."""

    def exchange(self, board: int, frame: bytes) -> bytes:
        """Pass a command frame to an emulated board and return its sensor frame."""
        return self.boards[board].exchange(frame)

    def exchange_time(self, board: int) -> float:
        """Duration [s] of a frame exchange with an emulated board."""
        return self.boards[board].faults.exchange_time

    def exchanged_at(self, board: int) -> float:
        """Time [s] of the last frame exchange with a board, which is the simulated time."""
        return self._now or 0.0

    def problem(self, board: int) -> str:
        """Return '', as the emulated bus never fails; frames show the faults of boards."""
        return ''

    def carry(self) -> None:
        """Stop the simulated arm and support its weight until every motor is ready."""
        self.plant.reset(self.plant.position)
        self.is_carried = True
        self.plant.support = 1.0
        for _, _, motor, _, _ in self._drives:
            motor.encoder.velocity = 0.0
        for board in self.boards:
            board.prepare()  # because the frame that was prepared before describes a moving arm

    def put_back(self) -> None:
        """Move the simulated arm to its initial position and support it, before `enable`."""
        self._put(self._start)

    def put_at_rest(self) -> None:
        """Move the simulated arm to its home configuration and support it, before homing."""
        self._put(self._rest)

    def _put(self, target: Array) -> None:
        self.plant.restart(target)
        positions = target.tolist()
        for (_, _, motor, ratio, offset), q in zip(self._drives, positions, strict=True):
            motor.encoder.place((q - offset) * ratio)
        self.carry()

    def self_test(self, profile: FrameProfile) -> tuple[()]:
        """Return no result, because emulated boards have no wires."""
        return ()

    def advance(self, now: float) -> None:
        """Simulate boards and arm up to `now` [s], by at most 10 ms."""
        if self._now is None or now < self._now - _CATCH_UP:
            self._now = now
        late = now - self._now - _CATCH_UP
        if late > 0.0:
            self.slipped += late
            self._now += late
        steps = max(0, int((now - self._now) / SUBSTEP + 1e-6))
        self._now += steps * SUBSTEP
        if steps and self.plant.support > 0.0:
            self._release(steps * SUBSTEP)
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

    def _release(self, duration: float) -> None:
        if self.is_carried:
            motors = [motor for _, _, motor, _, _ in self._drives]
            self.is_carried = not all(motor.ready and motor.enabled for motor in motors)
        else:
            self.plant.support -= duration / _RELEASE_TIME
