"""The last word on what the motors are asked to do."""

from collections import Counter
from math import inf, nan

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_buffer import Array, CommandBuffer
from aerarm_ros.hardware.gate.joint_limiter import JointLimiter


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

    Attributes
    ----------
    stop
        Reason of the latched stop, '' if there is none.
    limited
        Number of times each limit acted on a joint, by its name in `joint_limiter.LIMITED`.
    last_limited, last_limited_time
        The last limit that acted, and when [s].
    brake
        (n,) velocities [rad/s] to which torque-controlled joints that are too fast shall be
        damped; NaN for the others.
    """

    def __init__(self, config: ArmConfig, settings: BridgeSettings) -> None:
        self.stop = ''
        self.limited: Counter[str] = Counter()
        self.last_limited = ''
        self.last_limited_time = -inf
        self.brake: Array = np.full(config.n, nan)
        self._joints = [JointLimiter(joint, settings) for joint in config.joints]
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

    def limit(
        self, command: CommandBuffer, q: Array, dq: Array, dt: float, now: float
    ) -> CommandBuffer:
        """Return the command within limits, for a state q (n,) [rad], dq (n,) [rad/s].

        `dt` is the time since the last call [s], `now` the time for the record [s]. The
        returned object and `brake` are overwritten by the next call. A violation trips the
        stop: look at `stop` before using the result.
        """
        rows = zip(
            self._joints,
            command.q.tolist(),
            command.dq.tolist(),
            command.tau.tolist(),
            q.tolist(),
            dq.tolist(),
            strict=True,
        )
        for joint, position, velocity, effort, q_now, dq_now in rows:
            violation = joint.command_violation(position, velocity, effort, q_now)
            if violation:
                self.trip(violation)
            joint.limit(position, velocity, effort, q_now, dq_now, dt)
            if joint.limited:
                self.limited.update(joint.limited)
                self.last_limited = joint.limited[-1]
                self.last_limited_time = now
        out = self._out
        out.q[:] = [joint.position for joint in self._joints]
        out.dq[:] = [joint.velocity for joint in self._joints]
        out.tau[:] = [joint.effort for joint in self._joints]
        self.brake[:] = [joint.brake for joint in self._joints]
        return out
