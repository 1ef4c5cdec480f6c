"""Safety gate of the bridge: limits joint commands, and stops the arm after a violation."""

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

# Text on the effect of each limit on a command, for the list of faults.
LIMITED: dict[str, str] = {
    'position': 'a position reference beyond its limit was clipped to the limit',
    'velocity': 'a reference faster than the velocity limit was slowed to the limit',
    'soft_zone': (
        'motion was slowed near a position limit, because of another joint or of a warm motor'
    ),
    'braking': 'a joint was braked before a position or velocity limit',
    'effort': 'an effort above its limit was clipped to the limit',
    'effort_rate': 'an effort that changed too fast was limited to the largest rate',
}


# Largest reference speed relative to the speed from which the joint can brake. The second fraction
# of the speed limit is always allowed, so that the reference reaches the position limit.
_REFERENCE_SHARE = 0.96
_SLOWEST_SHARE = 0.005


class JointLimiter:
    """Limits the references of a joint, and detects references that require a stop.

    References towards a position limit are slowed to just below the speed from which the joint can
    still brake. The `barrier` in turn limits the actual motion of the joint.

    Plain floats are used, because they are faster than arrays for four joints; NaN means unused.

    Attributes
    ----------
    position, velocity, effort
        Limited references [rad], [rad/s], [Nm]; NaN where unused.
    effort_limit
        Largest effort [Nm]: the configured limit, or less while the motor is warm.
    barrier
        Barrier that knows the speed from which the joint can brake.
    limited
        Names of the limits applied in the last call, keys of `LIMITED`.
    """

    def __init__(self, joint: JointConfig, settings: BridgeSettings, barrier: JointBarrier) -> None:
        self.position = self.velocity = self.effort = nan
        self.barrier = barrier
        self.limited: list[str] = []
        self._name = joint.name
        self._position_min, self._position_max = joint.position_min, joint.position_max
        tolerance = settings.position_tolerance
        self._lowest, self._highest = joint.position_min - tolerance, joint.position_max + tolerance
        self._velocity_max = joint.velocity_max
        self._velocity_stop = settings.velocity_factor * joint.velocity_max
        self._effort_max = self.effort_limit = joint.effort_max
        self._effort_stop = settings.effort_factor * joint.effort_max
        self._effort_rate_max = joint.effort_rate_max
        self._error_max = settings.position_error_max
        self.restart()

    def restart(self) -> None:
        """Discard the last references, so that later ones start from the measured position."""
        self._last_position = nan
        self._last_effort = 0.0

    def is_inside(self, q: float) -> bool:
        """Return whether a joint angle [rad] is within its limits or their tolerance."""
        return self._lowest <= q <= self._highest

    def state_violation(self, q: float, dq: float) -> str:
        """Return a text if position [rad] or velocity [rad/s] require a stop, otherwise ''."""
        if not self._lowest <= q <= self._highest:
            return (
                f'{self._name} is at {q:.3f} rad, outside its limits {self._position_min:.3f} to '
                f'{self._position_max:.3f}: disable the arm, move it back by hand, then clear '
                'the fault'
            )
        if not abs(dq) <= self._velocity_stop:
            return (
                f'{self._name} runs at {dq:.2f} rad/s, above its limit of '
                f'{self._velocity_max:.2f}: check the controller and the encoder'
            )
        return ''

    def command_violation(self, position: float, velocity: float, effort: float, q: float) -> str:
        """Return a text if a command requires a stop, otherwise ''; NaN is an unused reference."""
        what = ''
        if position == position and not self.is_inside(position):
            what = f'a position of {position:.3f} rad, outside its limits'
        elif abs(position - q) > self._error_max:
            what = f'a position of {position:.3f} rad while it is at {q:.3f}, too far for one step'
        elif abs(velocity) > self._velocity_stop:
            what = (
                f'a velocity of {velocity:.2f} rad/s, above its limit of {self._velocity_max:.2f}'
            )
        elif abs(effort) > self._effort_stop:
            what = f'an effort of {effort:.2f} Nm, above its limit of {self._effort_max:.2f}'
        return what and f'{self._name} was commanded {what}: check the controller'

    def limit(self, position: float, velocity: float, effort: float, q: float, dt: float) -> None:
        """Limit the references of a joint at q [rad]; the last call was dt [s] before."""
        self.limited.clear()
        self.position = position if position != position else self._position(position, q, dt)
        self._last_position = self.position
        self.velocity = velocity
        if velocity == velocity:
            most = self._velocity_max
            if not -most <= velocity <= most:
                velocity = self._held(velocity, -most, most, 'velocity')
            slowest, fastest = self._speeds(q)
            if not slowest <= velocity <= fastest:
                velocity = self._held(velocity, slowest, fastest, 'soft_zone')
            self.velocity = velocity
        if effort == effort:
            self.effort = self._last_effort = self._limited_effort(effort, dt)
        else:
            self.effort, self._last_effort = nan, 0.0

    def _speeds(self, q: float) -> tuple[float, float]:
        """Return the largest allowed reference speeds at q [rad], negative and positive."""
        most, far = self._velocity_max, self.barrier.far
        if not self.barrier.is_slowed and (
            self._position_min + far <= q <= self._position_max - far
        ):
            return -most, most
        speed, slowest = self.barrier.speed, _SLOWEST_SHARE * most
        up = _REFERENCE_SHARE * speed(self._position_max - q)
        down = _REFERENCE_SHARE * speed(q - self._position_min)
        down = slowest if down < slowest else most if down > most else down
        return -down, slowest if up < slowest else most if up > most else up

    def _position(self, position: float, q: float, dt: float) -> float:
        position = self._held(position, self._position_min, self._position_max, 'position')
        # A reference step is followed at the largest allowed speed.
        start = q if self._last_position != self._last_position else self._last_position
        slowest, fastest = self._speeds(start)
        lowest, highest = start + slowest * dt, start + fastest * dt
        if lowest <= position <= highest:  # the usual case
            return position
        step = self._velocity_max * dt
        position = self._held(position, start - step, start + step, 'velocity')
        return self._held(position, lowest, highest, 'soft_zone')

    def _limited_effort(self, effort: float, dt: float) -> float:
        effort = self._held(effort, -self.effort_limit, self.effort_limit, 'effort')
        step = self._effort_rate_max * dt
        last = self._last_effort
        return self._held(effort, last - step, last + step, 'effort_rate')

    def _held(self, value: float, lowest: float, highest: float, name: str) -> float:
        """Clip a reference to bounds; record the limit `name` if this changes the reference."""
        if lowest <= value <= highest:
            return value
        self.limited.append(name)
        return min(max(value, lowest), highest)


# Fraction of the speed limits; encoder noise and the motion of a supported arm stay below it. A
# released arm exceeds it within 0.04 s, and above it the alignment field loses the rotor.
_AT_REST = 0.05
# [s] longer times between two measurements do not count as time of overload.
_INTERVAL_MAX = 5e-3


class SafetyGate:
    """Limits joint commands, and stops the arm if a command or joint is far beyond a limit.

    A command slightly over a limit is limited and counted. A command far over a limit is a
    violation, and so is a joint that leaves its position or speed range. After a violation `stop`
    contains the reason, and the bridge damps the arm until `release`.

    Parameters
    ----------
    config
        Configuration with the joints' limits.
    settings
        Tolerances and the soft zone.
    loads
        Loads and inertias of the joints.

    Attributes
    ----------
    stop
        Reason of the latched stop, or ''.
    limited
        Number of times that each limit changed a reference, by the name of the limit in `LIMITED`.
    last_limited, last_limited_time
        Name of the last limit that changed a reference, and its time [s].
    barriers
        One `JointBarrier` per joint, updated by `watch`.
    loads, inertias
        Modelled loads [Nm] and inertias [kg m^2] at the last call of `watch`; 0 and NaN before the
        first.
    """

    def __init__(self, config: ArmConfig, settings: BridgeSettings, loads: JointLoads) -> None:
        self.stop = ''
        self.limited: Counter[str] = Counter()
        self.last_limited = ''
        self.last_limited_time = -inf
        self.barriers = [
            JointBarrier(joint, settings, deceleration, inertia)
            for joint, deceleration, inertia in zip(
                config.joints, loads.deceleration.tolist(), loads.inertia_max.tolist(), strict=True
            )
        ]
        self._config = config
        self._loads = loads
        self._joints = [
            JointLimiter(joint, settings, barrier)
            for joint, barrier in zip(config.joints, self.barriers, strict=True)
        ]
        self.loads, self.inertias = [0.0] * config.n, [nan] * config.n

    def trip(self, reason: str) -> None:
        """Stop the arm until `release`; keep the reason of an earlier stop."""
        if not self.stop:
            self.stop = reason

    def release(self) -> None:
        """End the latched stop of the arm."""
        self.stop = ''
        self.restart()

    def restart(self) -> None:
        """Discard the last references, so that later ones start from the arm's position."""
        for joint in self._joints:
            joint.restart()
        # The barriers keep their state: they monitor the arm and not the commands.

    def is_inside(self, q: Array) -> bool:
        """Return whether all joint angles (n,) [rad] are within their limits or tolerances."""
        return all(self._joints[i].is_inside(angle) for i, angle in enumerate(q.tolist()))

    def state_violation(self, q: Array, dq: Array) -> str:
        """Return a text if a joint is beyond its limits at q [rad] and dq [rad/s], or ''."""
        angles, speeds = q.tolist(), dq.tolist()
        for i, joint in enumerate(self._joints):
            if violation := joint.state_violation(angles[i], speeds[i]):
                return violation
        return ''

    def alignment_refusal(self, q: Array, dq: Array) -> str:
        """Return a text if the motors may not align at q [rad] and dq [rad/s], otherwise ''."""
        if not self.is_inside(q):
            return (
                f'joints at {np.round(q, 3)} rad are outside their limits: move the arm back '
                'by hand'
            )
        moving = self._faster_than(_AT_REST, dq)
        return moving and f'{moving}: hold the arm, wait until it rests, then enable it'

    def watch_alignment(self, dq: Array) -> None:
        """Stop the arm if its joint speeds dq (n,) [rad/s] show a fall during alignment."""
        falling = self._faster_than(1.0, dq)
        if falling:
            self.trip(f'{falling} while the motors align: support the arm, and enable again')

    def watch(
        self,
        q: Array,
        dq: Array,
        effort: Array,
        age: Sequence[float],
        interval: Sequence[float],
        kept: Sequence[float],
        unconfirmed: Sequence[int],
    ) -> None:
        """Update the barriers of all joints; call once per cycle while the motors are driven.

        Arguments as in `JointBarrier.update`, n each; `unconfirmed` as in `ArmMeasurements`. If it
        exceeds 1, the torque `kept` acted between the last measurements.
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
            age,
            interval,
            kept,
            unconfirmed,
            strict=True,
        ):
            barrier.update(angle, speed, torque, load, inertia, old, time, torque_kept, number > 1)
            overwhelmed += barrier.is_overwhelmed
            slowed = slowed or barrier.is_slowed
        # Without a new measurement, or after a pause with unknown motion, the speeds stay.
        if (overwhelmed or slowed) and all(time <= _INTERVAL_MAX for time in interval):
            self._slow(overwhelmed, max(interval))

    def _slow(self, overwhelmed: int, interval: float) -> None:
        """Lower the speed limits of other joints by a step if a drive cannot brake its joint.

        An example: in an arm with payload, joint 1 at full speed loads joint 2 outward with more
        torque than the drive of joint 2 has.
        """
        for barrier in self.barriers:
            if overwhelmed > barrier.is_overwhelmed:
                barrier.lower_speed_limit(interval)
            else:
                barrier.recover(interval)

    def limit_effort(self, joint: int, effort: float) -> None:
        """Set the largest effort [Nm] that a command may request from the joint of this number."""
        self._joints[joint].effort_limit = effort

    def reset_barriers(self) -> None:
        """Reset the motion estimates of all barriers while the motors are off."""
        for barrier in self.barriers:
            barrier.restart()

    def note_braking(self, now: float) -> None:
        """Count an intervention of a barrier, which braked a joint at the time `now` [s]."""
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
        """Limit a command joint by joint, set the motor references, and apply the barriers.

        A violation by any joint trips the stop. The motors then do not follow the command; the
        caller must check `stop` and damp the arm.

        Parameters
        ----------
        command
            References of the n joints.
        q
            (n,) positions of the joints [rad].
        dt
            Time since the last call [s].
        now
            Time [s] with which limits are recorded.
        motors
            n motor references to set.
        trusted
            n flags; False for joints with a doubted encoder, a silent board or motors that the
            board does not drive. These joints have no barrier.

        Returns
        -------
        bool
            Whether a joint is braked at its barrier.
        """
        positions, velocities, efforts = command.rows.tolist()
        angles = q.tolist()
        for i, joint in enumerate(self._joints):
            violation = joint.command_violation(positions[i], velocities[i], efforts[i], angles[i])
            if violation:
                self.trip(violation)
        is_followed, is_braked = not self.stop, False
        for i, joint in enumerate(self._joints):
            joint.limit(positions[i], velocities[i], efforts[i], angles[i], dt)
            for name in joint.limited:
                self._note(name, now)
            if is_followed:
                motors[i].track(joint.position, joint.velocity, joint.effort, angles[i], dt)
                if trusted[i] and motors[i].keep_within(joint.barrier):
                    is_braked = True
        return is_braked

    def _faster_than(self, share: float, dq: Array) -> str:
        """Return a text that names joints faster than `share` of their speed limit, or ''."""
        speeds = np.abs(dq).tolist()
        moving = [
            f'{joint.name} moves at {speeds[i]:.2f} rad/s'
            for i, joint in enumerate(self._config.joints)
            if speeds[i] > share * joint.velocity_max
        ]
        return ', '.join(moving)

    def _note(self, limit: str, now: float) -> None:
        self.limited[limit] += 1
        self.last_limited, self.last_limited_time = limit, now
