"""The last word on what the motors are asked to do."""

from collections import Counter
from collections.abc import Sequence
from math import inf

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_buffer import Array, CommandBuffer
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier
from aerarm_ros.hardware.gate.joint_limiter import JointLimiter
from aerarm_ros.hardware.gate.joint_loads import JointLoads

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
        self._out = CommandBuffer(config.n)

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
            return f'joints at {np.round(q, 3)} rad are beyond their limits'
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
        columns = (q.tolist(), dq.tolist(), effort.tolist(), self.loads, self.inertias)
        times = age.tolist(), interval.tolist()
        rows = zip(self.barriers, unconfirmed, *columns, *times, kept, strict=True)
        for barrier, number, *row in rows:
            barrier.update(*row, number > 1)
        overwhelmed = sum(barrier.is_overwhelmed for barrier in self.barriers)
        slowed = any(barrier.is_slowed for barrier in self.barriers)
        if overwhelmed or slowed:
            self._slow(overwhelmed, float(interval.max()))

    def _slow(self, overwhelmed: int, interval: float) -> None:
        """Slow whatever moves beside joints that their drives do not brake, for a time [s].

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

    def limit(self, command: CommandBuffer, q: Array, dt: float, now: float) -> CommandBuffer:
        """Return the command within limits, for joints at q (n,) [rad].

        `dt` is the time since the last call [s], `now` the time for the record [s]. The
        returned object is overwritten by the next call. A violation trips the stop: look at
        `stop` before using the result.
        """
        rows = zip(
            self._joints,
            command.q.tolist(),
            command.dq.tolist(),
            command.tau.tolist(),
            q.tolist(),
            strict=True,
        )
        for joint, position, velocity, effort, q_now in rows:
            violation = joint.command_violation(position, velocity, effort, q_now)
            if violation:
                self.trip(violation)
            joint.limit(position, velocity, effort, q_now, dt)
            for name in joint.limited:
                self._note(name, now)
        out = self._out
        out.q[:] = [joint.position for joint in self._joints]
        out.dq[:] = [joint.velocity for joint in self._joints]
        out.tau[:] = [joint.effort for joint in self._joints]
        return out

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
