"""The last word on what the motors are asked to do."""

from collections import Counter
from collections.abc import Sequence
from math import inf, nan

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drive_config import JointConfig
from aerarm_ros.hardware.boards.motor_references import MotorReference
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import CommandBuffer
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier, JointLoads
from aerarm_ros.motion.signals import Array

# What a limit did to a command, for the list of faults.
LIMITED: dict[str, str] = {
    'position': 'a position reference beyond its limit was clipped to the limit',
    'velocity': 'a reference faster than the velocity limit was slowed to the limit',
    'soft_zone': (
        'motion towards a position limit was slowed near the limit, or because of another joint'
    ),
    'braking': 'a joint was braked before a position or velocity limit',
    'effort': 'an effort above its limit was clipped to the limit',
    'effort_rate': 'an effort that changed too fast was limited in its rate',
}


# A reference has at most this share of the speed from which the joint can be braked, and may
# always have this share of the speed limit, or it would never reach the position limit.
_REFERENCE_SHARE = 0.96
_CREEP_SHARE = 0.005


class JointLimiter:
    """Limits the references of one joint, and stops the arm if they exceed a tolerance.

    References towards a position limit are slowed to what the joint can still be braked from,
    with a little to spare. What a joint then does is the `barrier`'s.

    Plain numbers, not arrays: for four joints that is faster, and NaN means unused.

    Attributes
    ----------
    position, velocity, effort
        The limited references [rad], [rad/s], [Nm]; NaN where unused.
    effort_limit
        Largest effort [Nm]: that of the configuration, or less while the motor is warm.
    barrier
        Says from which speed the joint can be braked.
    limited
        Names of the limits that acted in the last call, keys of `LIMITED`.
    """

    __slots__ = (
        '_effort_max',
        '_effort_rate_max',
        '_last_effort',
        '_last_position',
        '_name',
        '_position_max',
        '_position_min',
        '_settings',
        '_velocity_max',
        'barrier',
        'effort',
        'effort_limit',
        'limited',
        'position',
        'velocity',
    )

    def __init__(self, joint: JointConfig, settings: BridgeSettings, barrier: JointBarrier) -> None:
        self.position = self.velocity = self.effort = nan
        self.barrier = barrier
        self.limited: list[str] = []
        self._name = joint.name
        self._settings = settings
        self._position_min, self._position_max = joint.position_min, joint.position_max
        self._velocity_max = joint.velocity_max
        self._effort_max = self.effort_limit = joint.effort_max
        self._effort_rate_max = joint.effort_rate_max
        self.restart()

    def restart(self) -> None:
        """Forget the last references: the next ones start from where the joint is."""
        self._last_position = nan
        self._last_effort = 0.0

    def is_inside(self, q: float) -> bool:
        """Whether the joint is within its range, tolerance included."""
        tolerance = self._settings.position_tolerance
        return self._position_min - tolerance <= q <= self._position_max + tolerance

    def state_violation(self, q: float, dq: float) -> str:
        """Return why the joint's position [rad] or velocity [rad/s] demands a stop, or ''."""
        if not self.is_inside(q):
            return (
                f'{self._name} is at {q:.3f} rad, outside its limits {self._position_min:.3f} to '
                f'{self._position_max:.3f}: disable the arm, move it back by hand, then clear '
                'the fault'
            )
        if not abs(dq) <= self._settings.velocity_factor * self._velocity_max:
            return (
                f'{self._name} runs at {dq:.2f} rad/s, above its limit of '
                f'{self._velocity_max:.2f}: check the controller and the encoder'
            )
        return ''

    def command_violation(self, position: float, velocity: float, effort: float, q: float) -> str:
        """Return why a command demands a stop, or ''; comparisons with NaN are all false."""
        settings, what = self._settings, ''
        if position == position and not self.is_inside(position):
            what = f'a position of {position:.3f} rad, outside its limits'
        elif abs(position - q) > settings.position_error_max:
            what = f'a position of {position:.3f} rad while it is at {q:.3f}, too far for one step'
        elif abs(velocity) > settings.velocity_factor * self._velocity_max:
            what = (
                f'a velocity of {velocity:.2f} rad/s, above its limit of {self._velocity_max:.2f}'
            )
        elif abs(effort) > settings.effort_factor * self._effort_max:
            what = f'an effort of {effort:.2f} Nm, above its limit of {self._effort_max:.2f}'
        return what and f'{self._name} was commanded {what}: check the controller'

    def limit(self, position: float, velocity: float, effort: float, q: float, dt: float) -> None:
        """Limit references for a joint at q [rad], dt [s] after the last call."""
        self.limited.clear()
        self.position = position if position != position else self._position(position, q, dt)
        self._last_position = self.position
        self.velocity = velocity
        if velocity == velocity:
            velocity = self._held(velocity, -self._velocity_max, self._velocity_max, 'velocity')
            slowest, fastest = self._speeds(q)
            self.velocity = self._held(velocity, slowest, fastest, 'soft_zone')
        self.effort = self._effort(effort, dt)

    def _speeds(self, q: float) -> tuple[float, float]:
        """Return the most negative and the most positive speed of a reference at q [rad]."""
        most, far = self._velocity_max, self.barrier.far
        if not self.barrier.is_slowed and (
            self._position_min + far <= q <= self._position_max - far
        ):
            return -most, most
        speed, creep = self.barrier.speed, _CREEP_SHARE * most
        up = _REFERENCE_SHARE * speed(self._position_max - q)
        down = _REFERENCE_SHARE * speed(q - self._position_min)
        return -min(max(down, creep), most), min(max(up, creep), most)

    def _position(self, position: float, q: float, dt: float) -> float:
        position = self._held(position, self._position_min, self._position_max, 'position')
        # A reference that steps is led there at the largest speed allowed.
        start = q if self._last_position != self._last_position else self._last_position
        step = self._velocity_max * dt
        position = self._held(position, start - step, start + step, 'velocity')
        slowest, fastest = self._speeds(start)
        return self._held(position, start + slowest * dt, start + fastest * dt, 'soft_zone')

    def _effort(self, effort: float, dt: float) -> float:
        if effort != effort:
            self._last_effort = 0.0
            return effort
        effort = self._held(effort, -self.effort_limit, self.effort_limit, 'effort')
        step = self._effort_rate_max * dt
        last = self._last_effort
        self._last_effort = self._held(effort, last - step, last + step, 'effort_rate')
        return self._last_effort

    def _held(self, value: float, lowest: float, highest: float, name: str) -> float:
        """Return the value held within bounds, and note if that changed it."""
        if lowest <= value <= highest:
            return value
        self.limited.append(name)
        return min(max(value, lowest), highest)


# Share of the speed limits that counts and a hand which holds the arm stay below; an arm that is
# let go passes it in 0.04 s, and above it the field of an alignment loses the rotor.
_AT_REST = 0.05
# [s] between two measurements; longer ones say nothing of how long a joint was overwhelmed.
_INTERVAL_MAX = 5e-3


class SafetyGate:
    """Limits commands, and stops the arm for good when limits are not enough.

    A command somewhat over a limit is limited and counted. What is far over a limit, and a
    joint that itself leaves its range or speed, is a violation: `stop` then holds the
    reason, and the bridge damps the arm until `release`.

    Parameters
    ----------
    config
        The joints' limits.
    settings
        Tolerances and the soft zone.
    loads
        What the joints carry and move.

    Attributes
    ----------
    stop
        Reason of the latched stop, '' if there is none.
    limited
        Number of times each limit acted on a joint, by its name in `joint_limiter.LIMITED`.
    last_limited, last_limited_time
        The last limit that acted, and when [s].
    barriers
        One `JointBarrier` a joint, as of the last call of `watch`.
    loads, inertias
        What the joints carry by the model [Nm], and what they move [kg m^2], as of then; empty
        before.
    """

    def __init__(self, config: ArmConfig, settings: BridgeSettings, loads: JointLoads) -> None:
        self.stop = ''
        self.limited: Counter[str] = Counter()
        self.last_limited = ''
        self.last_limited_time = -inf
        self.barriers = [
            JointBarrier(joint, settings, deceleration, inertia)
            for joint, deceleration, inertia in zip(
                config.joints,
                loads.deceleration.tolist(),
                loads.inertia_max.tolist(),
                strict=True,
            )
        ]
        self._config = config
        self._loads = loads
        self._joints = [
            JointLimiter(joint, settings, barrier)
            for joint, barrier in zip(config.joints, self.barriers, strict=True)
        ]
        self.loads: list[float] = []
        self.inertias: list[float] = []

    def trip(self, reason: str) -> None:
        """Latch a stop; the first reason stays."""
        if not self.stop:
            self.stop = reason

    def release(self) -> None:
        """End the latched stop."""
        self.stop = ''
        self.restart()

    def restart(self) -> None:
        """Forget the last command: the next one starts from where the arm is."""
        for joint in self._joints:
            joint.restart()
        # The barriers go on: they watch the arm, not the commands.

    def is_inside(self, q: Array) -> bool:
        """Whether the joints (n,) [rad] are within their limits, tolerance included."""
        return all(
            joint.is_inside(value) for joint, value in zip(self._joints, q.tolist(), strict=True)
        )

    def state_violation(self, q: Array, dq: Array) -> str:
        """Return which joint left its range [rad] or runs too fast [rad/s], or ''; (n,) each."""
        rows = zip(self._joints, q.tolist(), dq.tolist(), strict=True)
        violations = (joint.state_violation(angle, speed) for joint, angle, speed in rows)
        return next(filter(None, violations), '')

    def alignment_refusal(self, q: Array, dq: Array) -> str:
        """Return why motors may not align at q [rad] and dq [rad/s], (n,) each, or ''."""
        if not self.is_inside(q):
            return (
                f'joints at {np.round(q, 3)} rad are outside their limits: move the arm back '
                'by hand'
            )
        moving = self._faster_than(_AT_REST, dq)
        return moving and f'{moving}: hold the arm, wait until it rests, then enable it'

    def watch_alignment(self, dq: Array) -> None:
        """Trip the stop if the arm falls, (n,) speeds [rad/s], while its motors align."""
        falling = self._faster_than(1.0, dq)
        if falling:
            self.trip(f'{falling} while the motors align: support the arm, and enable again')

    def watch(
        self,
        q: Array,
        dq: Array,
        effort: Array,
        age: Array,
        interval: Array,
        kept: Sequence[float],
        unconfirmed: Sequence[int],
    ) -> None:
        """Update `barriers`; once a cycle while the motors are driven.

        Arguments as those of `JointBarrier.update`, n each; `unconfirmed` as of
        `ArmMeasurements`: above 1 the torque that was kept acted between the last measurements.
        """
        self.loads, self.inertias = self._loads.at(q, dq, effort)
        overwhelmed, slowed = 0, False
        for barrier, angle, speed, torque, load, inertia, old, time, torque_kept, number in zip(
            self.barriers,
            q.tolist(),
            dq.tolist(),
            effort.tolist(),
            self.loads,
            self.inertias,
            age.tolist(),
            interval.tolist(),
            kept,
            unconfirmed,
            strict=True,
        ):
            barrier.update(angle, speed, torque, load, inertia, old, time, torque_kept, number > 1)
            overwhelmed += barrier.is_overwhelmed
            slowed = slowed or barrier.is_slowed
        if overwhelmed or slowed:
            self._slow(overwhelmed, float(interval.max()))

    def _slow(self, overwhelmed: int, interval: float) -> None:
        """Slow all joints while drives fail to brake a joint, for a time [s].

        Joint 1 at full speed throws a loaded arm outward with more torque than joint 2 has.
        """
        if not interval <= _INTERVAL_MAX:
            return  # no new measurement, or a pause, of which nobody knows what it did
        for barrier in self.barriers:
            if overwhelmed > barrier.is_overwhelmed:
                barrier.give_way(interval)
            else:
                barrier.recover(interval)

    def limit_effort(self, joint: int, effort: float) -> None:
        """Set the largest effort [Nm] that a command may ask of a joint, by its number."""
        self._joints[joint].effort_limit = effort

    def look_away(self) -> None:
        """Forget how the arm moved: its motors are off."""
        for barrier in self.barriers:
            barrier.restart()

    def note_braking(self, now: float) -> None:
        """Count that a joint was braked at a barrier, at `now` [s]."""
        self._note('braking', now)

    def follow(
        self,
        command: CommandBuffer,
        q: Array,
        dt: float,
        now: float,
        motors: Sequence[MotorReference],
        trusted: Sequence[bool],
    ) -> bool:
        """Take a command through limits, motor references and barriers, joint by joint.

        A violation, of whichever joint, trips the stop. No motor follows the command then: look
        at `stop`, and damp the arm.

        Parameters
        ----------
        command
            References of the n joints.
        q
            (n,) positions of the joints [rad].
        dt
            Time since the last call [s].
        now
            Time for the record [s].
        motors
            What follows, n.
        trusted
            n, False for joints whose encoder is not trusted: they have no barrier.

        Returns
        -------
        bool
            Whether a joint is braked at its barrier.
        """
        columns = (command.q.tolist(), command.dq.tolist(), command.tau.tolist(), q.tolist())
        for joint, position, velocity, effort, angle in zip(self._joints, *columns, strict=True):
            violation = joint.command_violation(position, velocity, effort, angle)
            if violation:
                self.trip(violation)
        is_followed, is_braked = not self.stop, False
        for joint, motor, is_trusted, position, velocity, effort, angle in zip(
            self._joints, motors, trusted, *columns, strict=True
        ):
            joint.limit(position, velocity, effort, angle, dt)
            for name in joint.limited:
                self._note(name, now)
            if is_followed:
                motor.track(joint.position, joint.velocity, joint.effort, angle, dt)
                if is_trusted and motor.keep_within(joint.barrier):
                    is_braked = True
        return is_braked

    def _faster_than(self, share: float, dq: Array) -> str:
        """Return which joints move at more than a share of their limits, or ''."""
        moving = [
            f'{joint.name} moves at {abs(speed):.2f} rad/s'
            for joint, speed in zip(self._config.joints, dq.tolist(), strict=True)
            if abs(speed) > share * joint.velocity_max
        ]
        return ', '.join(moving)

    def _note(self, limit: str, now: float) -> None:
        self.limited[limit] += 1
        self.last_limited, self.last_limited_time = limit, now
