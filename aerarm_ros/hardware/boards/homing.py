"""Homing: search for the zeros of incremental encoders by their index pulses."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig, DriveTrain
from aerarm_ros.hardware.boards.board_link import ArmMeasurements
from aerarm_ros.hardware.gate.command_intake import CommandBuffer, Mask
from aerarm_ros.motion.signals import Array

# Largest error of the motor angle at the start of homing, in motor turns, for which the right
# pulse is identified.
REST_SHARE = 1.0 / 3.0
_TURN = 2.0 * np.pi


class EncoderZeros:
    """Record of the joints with a known encoder zero, and of the reasons for unknown zeros.

    An incremental encoder counts from its angle at power-on, so its zero is initially unknown.
    Homing finds the zero by index pulses, one per motor turn. The home configuration, into which
    the user moves the arm, determines the number of the turn. The zero is lost if the board
    restarts, the encoder jumps, or the encoder stood still while its joint turned. Joint angles,
    and with them limits and loads, are then unknown until the arm is homed again.

    An absolute encoder knows its angle after power-on, so the configured zero is valid initially
    and after each restart.

    Parameters
    ----------
    encoders
        Encoder type of boards whose configuration names none, from the frame profile.

    Attributes
    ----------
    rest
        (n,) motor angles of the home configuration [rad].
    absolute
        n flags, True for a joint with an absolute encoder.
    names
        Names of the n joints.
    changes
        Number of times that the zero of a joint became known or unknown.
    """

    def __init__(self, config: ArmConfig, encoders: str = 'incremental') -> None:
        self.rest: Array = DriveTrain(config).joint_to_motor_position(
            np.array(config.rest_position)
        )
        self.names = config.joint_names
        self.changes = 0
        self._rest_position = config.rest_position
        self.absolute = config.absolute_encoders(encoders)
        self._lost: dict[int, str] = {}
        self.restarted(range(config.n), 'not homed since the bridge started')

    @property
    def are_lost(self) -> bool:
        """Whether the encoder zero of any joint is unknown."""
        return bool(self._lost)

    @property
    def known(self) -> list[bool]:
        """Whether the encoder zero of each joint is known, n flags."""
        return [joint not in self._lost for joint in range(len(self.names))]

    @property
    def unknown(self) -> list[str]:
        """Names of the joints whose encoder zero is unknown."""
        return [self.names[joint] for joint in sorted(self._lost)]

    def known_only(self, q: Array) -> Array:
        """Return joint positions (n,) [rad], with NaN for joints whose encoder zero is unknown."""
        if not self._lost:
            return q
        known = q.copy()
        known[list(self._lost)] = np.nan
        return known

    def restarted(self, joints: Iterable[int], reason: str) -> None:
        """Record a restart of the joints' boards; only absolute encoders keep their zeros."""
        joints = list(joints)
        self.found(joint for joint in joints if self.absolute[joint])
        self.lose((joint for joint in joints if not self.absolute[joint]), reason)

    def lose(self, joints: Iterable[int], reason: str) -> None:
        """Record that the encoder zeros of joints are lost; keep the reason of an earlier loss."""
        for joint in joints:
            self.changes += joint not in self._lost
            self._lost.setdefault(joint, reason)

    def explain(self, joints: Iterable[int], reason: str) -> None:
        """Replace the reason why the encoder zeros of joints are unknown."""
        self._lost.update((joint, reason) for joint in joints if joint in self._lost)

    def found(self, joints: Iterable[int] | None = None) -> None:
        """Record that the encoder zeros of joints (default: all) are known."""
        for joint in range(len(self.names)) if joints is None else joints:
            self.changes += self._lost.pop(joint, None) is not None

    @property
    def problem(self) -> str:
        """Text with the joints of unknown encoder zero, the reasons and the remedy, or ''."""
        if not self._lost:
            return ''
        reasons = dict.fromkeys(self._lost.values())
        return (
            f'the zero of {", ".join(self.unknown)} is unknown ({", ".join(reasons)}): bring the '
            f"arm to its home configuration, {self._posture()}, then run 'arm home'"
        )

    def refusal(self, motor_position: Array) -> str:
        """Return the reason if homing may not start at these motor angles (n,) [rad], or ''.

        Each joint with a known zero must be at its home position. For all other joints the user
        must ensure this.
        """
        turns = (np.abs(motor_position - self.rest) / _TURN).tolist()
        rows = zip(self.names, turns, self.known, strict=True)
        away = [name for name, part, known in rows if known and part > REST_SHARE]
        if not away:
            return ''
        be = 'is' if len(away) == 1 else 'are'
        return (
            f'{", ".join(away)} {be} not at the home configuration, {self._posture()}, so homing '
            'would use a wrong index pulse: move the arm there first'
        )

    def expected(self, motor_position: Array) -> Array:
        """Return assumed motor angles (n,) [rad]: of absolute encoders, otherwise those of home."""
        return np.where(self.absolute, motor_position, self.rest)

    def assumed_home(self) -> str:
        """Return the sentence on the assumed home configuration, for the answer to the user."""
        return f'homing assumes that the arm is at its home configuration, {self._posture()}'

    def _posture(self) -> str:
        rows = zip(self.names, self._rest_position, strict=True)
        return ', '.join(f'{name} {angle:.4g}' for name, angle in rows) + ' rad'


# [motor turns] A pulse farther than this from its expected angle cannot be assigned to a turn.
RESIDUAL_MAX = 1.0 / 3.0  # decision 76

_SPEED = 0.25  # [rad/s] joint speed while the zero is unknown
# [rad/s] largest joint speed of the return to home, [1/s] its gain
_RETURN_SPEED, _RETURN_GAIN = 0.3, 15.0
_RETURNED = 5e-4  # [rad] joint distance from home at which a return ends
_REACH = 1.05  # motor turns within which a pulse must come
# motor turns from the first pulse within which a pulse is the first pulse, passed again
_SAME_PULSE = 0.25
# tolerated difference between the distance of two pulses and one turn, in motor turns
_SPACING_ERROR = 0.02
_BLURRED = 6e-4  # [rad] largest joint motion between two frames, within which the pulse lies
_REPEATS_MAX = 10  # number of repetitions per joint
# Motor turns of free travel that two pulses require: on both sides of the home configuration, or
# on one side.
_ROOM_BOTH_SIDES = _REACH + RESIDUAL_MAX
_ROOM_ONE_SIDE = 2.0 * _REACH + RESIDUAL_MAX


class Homing:
    """Turns each motor slowly past two index pulses, which determine the encoder's zero.

    An incremental encoder counts from its angle at power-on; its index pulse comes once per motor
    turn, at a known angle within the turn. The number of the turn is known only if every motor
    starts within a third of a turn (about 4 degrees at the joint) of its home angle. Each motor
    turns to the nearest expected pulse, and then back to the pulse one turn before it. No motor
    moves farther than one turn from its start. A joint whose position limit is too near for the
    return continues to the next pulse instead. At the end each joint moves to its home
    configuration, so the arm can be homed again from there.

    Homing fails if a pulse lies farther than `RESIDUAL_MAX` from its expected angle, or if the two
    pulses are not one turn apart. Pulses cannot reveal a motor angle that is wrong by two thirds
    of a turn or more, because it looks like an angle near the next turn.

    The boards' own index offset compensation is not used, because a position jump in the running
    control law jerks the motor. The host records the position at the pulse, to within the 1 ms
    between two frames, and corrects it afterwards. The mean of two pulses passed in opposite
    directions is free of this error. If the host was delayed during a pulse, the pulse angle is
    uncertain, and the motor searches again in the other direction at half the speed. The
    repetitions end at a speed at which even the longest delay does not matter. A joint that
    passes its home configuration during a delay also returns at half the speed. Homing fails if a
    motor moves by more than a quarter of a turn between two frames.

    Parameters
    ----------
    position
        (n,) motor angles as reported at the start [rad].
    toggles
        (n,) index bits of the encoders at the start; each bit flips at an index pulse.
    expected
        (n,) expected motor angles at the start, accurate to a third of a turn [rad].
    pulse_offset
        (n,) or one for all: motor angle of an index pulse modulo one turn [rad], measured at
        commissioning. The configuration's `offset` assumes 0.

    Attributes
    ----------
    command
        Present command for all joints.
    fault
        Reason of a failure, or ''.
    doubted
        Numbers of joints whose index pulses contradict their known zeros.
    """

    def __init__(
        self,
        config: ArmConfig,
        position: Array,
        toggles: Mask,
        expected: Array,
        pulse_offset: ArrayLike = 0.0,
    ) -> None:
        self.command = CommandBuffer.standstill(config.n)
        self.fault = ''
        self.doubted: list[int] = []
        self._names = config.joint_names
        self._sign = config.column('sign')
        self._ratio = config.column('gear.ratio')
        self._start = position.copy()
        # [rad] motor angle from which the next pulse must come within `_REACH`
        self._reach_from = position.copy()
        self._toggles = toggles.copy()
        # [rad] difference between expected and reported motor angle
        self._shift = expected - position
        self._offset: Array = np.zeros(config.n) + np.asarray(pulse_offset, np.float64)
        self._side = homing_sides(config) * self._sign
        ahead = (self._offset - expected) / _TURN
        nearest = np.where(ahead >= np.round(ahead), 1.0, -1.0)
        self._direction = np.where(self._side == 0.0, nearest, self._side)
        self._first = np.full(config.n, np.nan)  # reported angle of the first pulse [rad]
        # mean angle of the two pulses, shifted to the turn of the first pulse
        self._pulse = np.zeros(config.n)
        self._home = DriveTrain(config).joint_to_motor_position(np.array(config.rest_position))
        self._found = np.zeros(config.n, dtype=bool)
        self._returned = np.zeros(config.n, dtype=bool)
        self._speed = np.full(config.n, _SPEED)
        self._last = position.copy()
        # [rad] distance from home of the joints that return
        self._away = np.full(config.n, np.nan)
        self._repeats = 0

    @property
    def is_done(self) -> bool:
        """Whether homing has ended, successfully or not."""
        return bool(self._returned.all()) or bool(self.fault)

    @property
    def zero(self) -> Array:
        """Encoder zeros: angles (n,) [rad] that the boards report at motor angle zero."""
        turn, _ = self._turn_and_residual(self._pulse)
        return self._pulse - self._offset - _TURN * turn

    @property
    def pulse_offset(self) -> Array:
        """Motor angles (n,) [rad] of the index pulses, under the assumption of exact `expected`."""
        return (self._pulse + self._shift) % _TURN

    def update(self, position: Array, toggles: Mask) -> None:
        """Compute the next joint command of the homing motion.

        Parameters
        ----------
        position
            (n,) reported motor angles [rad].
        toggles
            (n,) index bits.
        """
        moved = self._ratio * np.abs(position - self._last)
        self._last[:] = position
        self._fail_after_delay(moved / self._ratio / _TURN)
        # comparison is False before the first pulse, because the angle is NaN
        from_first = np.abs(position - self._first) / _TURN
        flipped = (toggles != self._toggles) & ~self._found
        if flipped.any():
            self._toggles[flipped] = toggles[flipped]
            valid = flipped & ~(from_first < _SAME_PULSE)
            blurred = valid & (moved > _BLURRED)
            if blurred.any():
                self._search_again(blurred, position)
            for joint in np.flatnonzero(valid & ~blurred).tolist():
                self._process_pulse(joint, position)
        self._fail_without_pulse(position)
        speed = self._speed * self._direction
        if self._found.any():
            speed = np.where(self._found, self._return_speed(position), speed)
        self.command.dq[:] = self._sign * speed

    def _return_speed(self, position: Array) -> Array:
        """Return joint speeds (n,) [rad/s] that return joints with a found zero to home."""
        away = self._ratio * (self.zero + self._home - position)
        # the joint passed its home position while the host was delayed
        passed = away * self._away < 0.0
        self._speed[passed] *= 0.5
        self._away = np.where(self._found, away, np.nan)
        self._returned |= self._found & (np.abs(away) < _RETURNED)
        speed = np.clip(_RETURN_GAIN * away, -_RETURN_SPEED, _RETURN_SPEED) * self._speed / _SPEED
        return np.where(self._returned, 0.0, speed)

    def _process_pulse(self, joint: int, position: Array) -> None:
        """Process an index pulse of a joint; `position` has the n reported motor angles [rad]."""
        self._speed[joint] = _SPEED
        if np.isnan(self._first[joint]):
            self._first[joint] = self._reach_from[joint] = position[joint]
            self._check_first(joint)
            back = -np.sign(position[joint] - self._start[joint]) or -self._direction[joint]
            self._direction[joint] = self._side[joint] or back
            return
        distance = position[joint] - self._first[joint]
        error = abs(distance) / _TURN - 1.0
        if abs(error) > _SPACING_ERROR:
            self._fail(
                [joint],
                f'homing found two index pulses of {self._names[joint]} that are '
                f'{1.0 + error:.2f} motor turns apart instead of 1: check the encoder, its disc '
                'and its cable',
            )
        self._pulse[joint] = self._first[joint] + 0.5 * (distance - np.copysign(_TURN, distance))
        self._found[joint] = True

    def _check_first(self, joint: int) -> None:
        """Fail if the first index pulse of a joint is too far from its expected angle."""
        residual = self._turn_and_residual(self._first)[1][joint]
        if abs(residual) <= RESIDUAL_MAX:
            return
        angle = abs(residual) * _TURN * self._ratio[joint]
        self._fail(
            [joint],
            f'homing found the index pulse of {self._names[joint]} {residual:+.2f} motor turns '
            f'({angle:.3f} rad at the joint) from its expected angle, above the limit of '
            f'{RESIDUAL_MAX:.2f}: bring the arm to its home configuration and run '
            "'arm home' again. If the arm was in this configuration, the encoder, motor or "
            'configuration has changed; commission the joint',
        )

    def _turn_and_residual(self, reported: Array) -> tuple[Array, Array]:
        """Return turn numbers and remainders [turns] of index pulses at reported angles (n,)."""
        turns = (reported + self._shift - self._offset) / _TURN
        turn = np.round(turns)
        return turn, turns - turn

    def _fail_without_pulse(self, position: Array) -> None:
        missed = ~self._found & (np.abs(position - self._reach_from) > _REACH * _TURN)
        if missed.any():
            joints = np.flatnonzero(missed).tolist()
            names = ', '.join(self._names[joint] for joint in joints)
            self._fail(
                joints,
                f'homing found no index pulse of {names} within one motor turn: check the '
                'encoder cable',
            )

    def _fail_after_delay(self, moved: Array) -> None:
        """Fail if a motor moved so far between two frames that its index pulse is ambiguous."""
        joint = int(np.argmax(moved))
        if moved[joint] > _SAME_PULSE:
            self._fail(
                [],
                f'homing was delayed while {self._names[joint]} moved by {moved[joint]:.2f} '
                f'motor turns, above the limit of {_SAME_PULSE:.2f}: check other processes on '
                "this computer, and the encoder, then run 'arm home' again",
            )

    def _search_again(self, blurred: Mask, position: Array) -> None:
        # the motor turned past the reach during a delay of the host
        self._reach_from[blurred] = position[blurred]
        self._direction[blurred] *= -1.0
        self._speed[blurred] *= 0.5
        self._repeats += 1
        if self._repeats > _REPEATS_MAX * len(self._names):
            self._fail(
                [],
                f'homing was delayed at {self._repeats} index pulses, so their position is '
                'unknown: check other processes on this computer',
            )

    def _fail(self, joints: list[int], reason: str) -> None:
        self.fault = self.fault or reason
        self.doubted += joints


def homing_sides(config: ArmConfig) -> Array:
    """Return on which sides of home each joint has enough range to find two index pulses.

    Returns
    -------
    (n,) ndarray
        0 if both sides of the home configuration have range for a turn; 1 or -1 if only the side of
        the upper or lower limit has enough range; NaN if neither side has.
    """
    turn = _TURN * config.column('gear.ratio')
    home = np.array(config.rest_position)
    above = (config.column('position_max') - home) / turn
    below = (home - config.column('position_min')) / turn
    below_only = np.where(below > _ROOM_ONE_SIDE, -1.0, np.nan)
    one_side = np.where(above > _ROOM_ONE_SIDE, 1.0, below_only)
    return np.where(np.minimum(above, below) > _ROOM_BOTH_SIDES, 0.0, one_side)


class ZeroSearch:
    """Starts `Homing`, at once or after the motors' alignment, and updates it once per cycle.

    Parameters
    ----------
    state
        Measurements reported by the boards.
    pulse_offset
        (n,) or one for all, as in `Homing` [rad]; each search reads the present value.

    Attributes
    ----------
    problem
        Reason why this arm can never be homed, or ''.
    motion
        Description of the homing motion.
    """

    def __init__(
        self, config: ArmConfig, state: ArmMeasurements, pulse_offset: ArrayLike = 0.0
    ) -> None:
        sides, turn = homing_sides(config), _TURN * config.column('gear.ratio')
        side = 'up to two turns to one side' if (sides != 0.0).any() else 'to either side'
        self.motion = (
            f'the joints turn slowly by one motor turn ({turn.min():.2f} to {turn.max():.2f} '
            f'rad), {side}, and return'
        )
        self.problem = ''
        for joint in np.flatnonzero(np.isnan(sides))[:1].tolist():
            self.problem = (
                f'{config.joint_names[joint]} cannot be homed, because homing needs '
                f'{_ROOM_BOTH_SIDES * turn[joint]:.2f} rad from the home configuration to both '
                f'position limits, or {_ROOM_ONE_SIDE * turn[joint]:.2f} rad to one: change '
                'rest_position or the limits, or use an absolute encoder'
            )
        self._config = config
        self._state = state
        self._pulse_offset = pulse_offset
        self._homing: Homing | None = None
        self._waits = False

    @property
    def is_on(self) -> bool:
        """Whether a search for the encoder zeros runs, or waits until the motors are aligned."""
        return self._waits or self._homing is not None

    def begin(self, expected: Array) -> Homing:
        """Start homing now; `expected` holds motor angles (n,) accurate to a third of a turn."""
        state = self._state
        homing = Homing(
            self._config, state.reported_position, state.index_toggle, expected, self._pulse_offset
        )
        self._homing, self._waits = homing, False
        return homing

    def wait(self) -> None:
        """Let the next `update`, with aligned motors, start homing from the measured angles."""
        self._waits = True

    def end(self) -> None:
        """Stop the search for the encoder zeros."""
        self._homing, self._waits = None, False

    def update(self) -> Homing:
        """Update homing with the last measurements of the aligned motors; return the homing."""
        state = self._state
        homing = self._homing or self.begin(state.motor_position)
        homing.update(state.reported_position, state.index_toggle)
        return homing
