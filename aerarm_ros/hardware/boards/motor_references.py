"""Conversion of joint references to motor references for the boards' control law (4.4)."""

from collections import deque
from collections.abc import Sequence
from math import inf, nan

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig, DriveTrain
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier
from aerarm_ros.motion.signals import Array

# number of stored references; without frames a board continues for at most 0.255 s, and a cycle
# lasts at least 0.5 ms
_SENT_KEPT = 512


class MotorReference:
    """Reference and gains of one motor for the control law (4.4) of its board.

    NaN means an unused value. Plain floats are used, because they are faster than arrays for four
    joints.

    Parameters
    ----------
    slope, intercept
        Motor angle [rad] = slope * joint angle [rad] + intercept.
    current_per_effort
        Motor current per joint torque [A/Nm].
    position_min, position_max
        Limits of the joint [rad].
    effort_max
        Largest torque of the joint [Nm].
    braking_kd
        Damping gain used to brake the joint, independent of the set gains [A s/rad].
    kd_max
        Largest damping gain that a frame can represent [A s/rad].

    Attributes
    ----------
    position, velocity, current, kp, kd, integral_gain
        As in `BoardCommand`: [rad], [rad/s], [A], [A/rad], [A s/rad], [A/(rad s)].
    load_current
        Current that may hold a load without moving it [A]: the commanded effort, or the load of a
        braked joint.
    noise
        Current that encoder quantization causes in a braked joint [A]; 0 if the joint is not
        braked.
    current_max
        Largest motor current that a reference may request [A]; the smaller of this value and the
        board's current limit applies.
    effort_limit
        Largest joint torque that a reference may request [Nm]; braking may use the full
        `effort_max`.
    zero
        Reported angle [rad] at motor angle zero.
    integral
        Estimated contribution of the board's integral term to the current [A], from references and
        measured angles; 0 without integral gain.
    joint_position
        Position reference at the joint [rad], NaN without a position reference.
    """

    def __init__(
        self,
        slope: float,
        intercept: float,
        current_per_effort: float,
        position_min: float,
        position_max: float,
        effort_max: float,
        braking_kd: float,
        kd_max: float,
    ) -> None:
        self._slope, self._intercept = slope, intercept
        self._current_per_effort = current_per_effort
        self._per_gain = abs(slope / current_per_effort)
        self._lowest, self._highest = position_min, position_max
        self._effort_max, self._braking_kd, self._kd_max = effort_max, braking_kd, kd_max
        self._most = self.effort_limit = effort_max
        self.zero = self.integral = 0.0
        self._sent: deque[tuple[float, float, float, float, float, float]] = deque(
            maxlen=_SENT_KEPT
        )
        self.set_gains(0.0, 0.0, 0.0, 0.0)
        self.release()

    def set_gains(self, kp: float, kd: float, integral_gain: float, reach: float) -> None:
        """Set the gains of the board's control law, in the units given for the attributes.

        `reach` is the largest distance of an integrated reference from the joint [rad].
        """
        self._board_kp, self._board_kd = kp, kd
        self._board_integral_gain = integral_gain
        self._reach = reach

    def set_zero(self, zero: float) -> None:
        """Change `zero` [rad]; the motor does not move, but the computed joint angle changes."""
        self.joint_position += (self.zero - zero) / self._slope
        self.zero = zero

    def release(self) -> None:
        """Set the motor's feed-forward current and gains to zero, so that it delivers no torque."""
        self.position = self.velocity = self.current = 0.0
        self.kp = self.kd = self.integral_gain = self.load_current = self.noise = 0.0
        self.current_max = inf
        self._most = self._effort_max
        self.joint_position = nan
        self._integrates = False

    def damp(self, speed_max: float = inf) -> None:
        """Damp the joint; limit the current to the one that damps the motor speed `speed_max`."""
        self.release()
        self.kd = self._board_kd
        if speed_max < inf:
            self.current_max = self.kd * speed_max

    def torque(self, q: float, dq: float) -> float:
        """Return the joint torque [Nm] that the board requests at q [rad] and dq [rad/s]."""
        return self._limited(self._present_law(q, dq))

    def note_sent(self) -> None:
        """Store the motor reference that this cycle's frame carries to the board."""
        self._sent.append(
            (self.position, self.velocity, self.current, self.kp, self.kd, self.integral_gain)
        )

    def kept_torque(self, q: float, dq: float, unconfirmed: int) -> float:
        """Return the joint torque [Nm] that the board requests if the last commands were lost.

        The board then keeps the command that is `unconfirmed` commands older than the last.
        """
        sent = self._sent
        return self._limited(self._law(*sent[-1 - min(unconfirmed, len(sent) - 1)], q, dq))

    def wind_up(self, q: float, duration: float) -> None:
        """Advance the estimated integral term by `duration` [s] at the mean joint angle q [rad]."""
        if self.integral_gain:
            most = abs(self._current_per_effort) * self._effort_max
            wound = self.integral + self.integral_gain * self._error(q) * duration
            self.integral = min(max(wound, -most), most)

    def track(self, position: float, velocity: float, effort: float, q: float, dt: float) -> None:
        """Set the motor's references, given limited joint references [rad], [rad/s], [Nm].

        References are NaN where unused. The joint is at q [rad], and `dt` is the time since the
        last call [s].
        """
        stiff = position == position or velocity == velocity
        speed = velocity if velocity == velocity else 0.0
        self._most = self.effort_limit
        is_reduced = self._most < self._effort_max
        self.current_max = abs(self._current_per_effort) * self._most if is_reduced else inf
        if position == position:
            reference = position
        elif stiff:
            reference = self._integrated(speed * dt, q)
        else:
            # the position has no effect without stiffness, but any frame must be able to
            # represent it
            reference = q
        self.joint_position = reference if stiff else nan
        self.kp = self._board_kp if stiff else 0.0
        self.kd = self._board_kd if stiff else 0.0
        self.integral_gain = self._board_integral_gain if stiff else 0.0
        self._integrates = stiff and position != position
        self.position = self._slope * reference + self._intercept + self.zero
        self.velocity = self._slope * speed
        self.current = self._current_per_effort * effort if effort == effort else 0.0
        self.load_current, self.noise = self.current, 0.0

    def keep_within(self, barrier: JointBarrier) -> bool:
        """Brake the joint if its references request more torque than its barrier allows.

        A pure torque reference may be allowed for one cycle, but make the joint too fast if the
        host is delayed. A pure torque reference therefore gets additional damping about the joint
        speed expected at the next frame. Other references get the same damping if their stiffness
        would make the joint too fast during such a delay.

        If the requested torque exceeds the barrier's bounds, the nearest bound replaces the
        reference. The bound is sent as a damping gain with a reference speed and without
        feed-forward current, so the torque falls as the joint accelerates while the board holds
        the frame.

        Returns
        -------
        bool
            Whether the joint is braked.
        """
        q, dq = barrier.q, barrier.filtered
        law = self._present_law(q, dq)
        asked = self._limited(law)
        if barrier.lowest <= asked <= barrier.highest:
            gap = self._gap_kd(barrier, asked, law)
            if self.kp == 0.0 and self.kd == 0.0:
                self.kd = gap
                self.velocity = self._slope * barrier.mean_filtered(asked) if gap else 0.0
            elif gap:
                # The torque falls as the joint accelerates, as it would with the original
                # reference.
                self.kp = self.integral_gain = self.current = 0.0
                self.kd = max(gap, self.kd)
                self.velocity = self._slope * dq + asked * self._current_per_effort / self.kd
            return False
        allowed = barrier.highest if asked > barrier.highest else barrier.lowest
        # `effort_limit` may be below the barrier's torque, but a joint must not exceed a position
        # or speed limit
        if self._most < self._effort_max:
            self._most, self.current_max = self._effort_max, inf
        torque = self._limited(allowed)
        if self._integrates and self.kp > 0.0:
            # The integral of a velocity reference must not grow while the joint is braked.
            excess = (asked - torque) * self._current_per_effort / (self.kp * self._slope)
            self.joint_position -= excess
        self.kp = self.kd = self.integral_gain = self.current = 0.0
        gap = self._gap_kd(barrier, torque, torque)
        self.kd = max(self._braking_kd, gap)
        self.load_current = barrier.load * self._current_per_effort
        self.noise = barrier.noise * abs(self._current_per_effort)
        self.position = self._slope * q + self._intercept + self.zero
        about = barrier.mean_filtered(torque) if gap else dq
        self.velocity = self._slope * about + torque * self._current_per_effort / self.kd
        return True

    def _gap_kd(self, barrier: JointBarrier, torque: float, law: float) -> float:
        """Return the damping gain [A s/rad] that limits the speed while commands are missing."""
        per_gain = self._per_gain
        damping = barrier.gap_damping(torque, law, self.kp * per_gain, self.kd * per_gain)
        return min(damping / per_gain, self._kd_max) if damping else 0.0

    def _present_law(self, q: float, dq: float) -> float:
        """Return the joint torque [Nm] by `_law` for the present references and gains."""
        return self._law(
            self.position, self.velocity, self.current, self.kp, self.kd, self.integral_gain, q, dq
        )

    def _law(
        self,
        position: float,
        velocity: float,
        current: float,
        kp: float,
        kd: float,
        integral_gain: float,
        q: float,
        dq: float,
    ) -> float:
        """Return the joint torque [Nm] of the control law for a reference, before saturation."""
        error = position - self.zero - self._slope * q - self._intercept
        current += kp * error + kd * (velocity - self._slope * dq)
        if integral_gain:
            current += self.integral
        return current / self._current_per_effort

    def _limited(self, torque: float) -> float:
        most = self._most
        if torque > most:
            return most
        return -most if torque < -most else torque

    def _error(self, q: float) -> float:
        """Return motor reference minus motor angle [rad], with the joint at q [rad]."""
        return self.position - self.zero - self._slope * q - self._intercept

    def _integrated(self, step: float, q: float) -> float:
        """Return the last position reference plus a step [rad], within reach and limits."""
        last = self.joint_position
        wanted = (last if last == last else q) + step
        least, most = q - self._reach, q + self._reach
        near = least if wanted < least else most if wanted > most else wanted
        return self._lowest if near < self._lowest else min(near, self._highest)


class MotorReferences:
    """References and gains of n motors for the boards' control law (4.4), in joint order.

    If a joint is commanded by velocity only, the velocity is integrated into a position reference.
    The proportional and derivative gains of the boards then act as the integral and proportional
    gains of the PI velocity loop, thesis (4.5). The integrated reference stays within the
    position limits and so close to the measured position that its torque does not exceed the
    joint's effort limit (anti-windup).

    Parameters
    ----------
    config
        Configuration with gains, limits and drive train.
    profile
        Frame layout, which determines the gains that a frame can represent.
    reach_max
        Largest distance of an integrated reference from the measured angle [rad].

    damping_min
        (n,) or one for all: smallest joint damping that the gain kd may cause [Nms/rad], so that
        a stopped arm does not fall; see `JointLoads`.

    Raises
    ------
    ValueError
        If the frame cannot represent the configuration's gains, or the damping is too small.

    Attributes
    ----------
    motors
        One `MotorReference` per joint.
    zero
        (n,) reported angles [rad] at motor angle zero.
    """

    def __init__(
        self,
        config: ArmConfig,
        profile: FrameProfile,
        reach_max: float,
        damping_min: ArrayLike = 0.0,
    ) -> None:
        drive = DriveTrain(config)
        ones, zeros = np.ones(config.n), np.zeros(config.n)
        columns = (
            drive.joint_to_motor_velocity(ones),
            drive.joint_to_motor_position(zeros),
            drive.effort_to_current(ones),
            config.column('position_min'),
            config.column('position_max'),
            config.column('effort_max'),
            config.column('board_kd'),
            np.full(config.n, profile.command.largest('kd')),
        )
        self.motors = [MotorReference(*row) for row in np.transpose(columns).tolist()]
        self.zero: Array = zeros
        self._profile = profile
        self._drive = drive
        self._effort_max = config.column('effort_max')
        self._reach_max = reach_max
        self._names = config.joint_names
        self._kd_min = drive.joint_to_motor_gain(np.broadcast_to(damping_min, (config.n,)))
        self.set_gains(config.column('board_kp'), config.column('board_kd'))

    @property
    def gains(self) -> list[tuple[float, float]]:
        """Gains Kp [A/rad] and Kd [A s/rad] that the boards use at present, per motor.

        While the joint is controlled by torque, Kp is zero, and Kd is the damping near a limit.
        """
        return [(motor.kp, motor.kd) for motor in self.motors]

    @property
    def integrates(self) -> bool:
        """Whether the integral term of any motor's control law is active."""
        return self._has_integral and any(motor.integral_gain for motor in self.motors)

    @property
    def feed_forward(self) -> list[float]:
        """Motor currents (n,) [A] for the commanded effort, or for the load of a braked joint."""
        return [motor.load_current for motor in self.motors]

    @property
    def braking_noise(self) -> list[float]:
        """Motor currents (n,) [A] that encoder quantization causes in braked joints, or 0."""
        return [motor.noise for motor in self.motors]

    def set_gains(self, kp: ArrayLike, kd: ArrayLike, integral_gain: ArrayLike = 0.0) -> None:
        """Set the boards' gains, motor side: (n,) or one for all [A/rad], [A s/rad], [A/(rad s)].

        Raises ValueError, and changes nothing, if the frame cannot represent a gain or kd does not
        damp a joint.
        """
        gains = self.check_gains(kp, kd, integral_gain)
        stiffness = np.maximum(self._drive.motor_to_joint_gain(gains[0]), 1e-9)
        reach = np.minimum(self._effort_max / stiffness, self._reach_max)
        for motor, row in zip(self.motors, np.transpose([*gains, reach]).tolist(), strict=True):
            motor.set_gains(*row)
        self._has_integral = bool(gains[2].any())

    def check_gains(
        self, kp: ArrayLike, kd: ArrayLike, integral_gain: ArrayLike = 0.0
    ) -> list[Array]:
        """Return the three gains as (n,) arrays; raise ValueError if a frame cannot carry one."""
        named = zip(('kp', 'kd', 'integral_gain'), (kp, kd, integral_gain), strict=True)
        gains = [self._checked(name, gain) for name, gain in named]
        # The gain is checked as rounded by the frame, because a frame field may be coarse.
        count = self._profile.command.count_of('kd')
        damping = np.round(gains[1] / count) * count
        for name, given, least in zip(
            self._names, damping.tolist(), self._kd_min.tolist(), strict=True
        ):
            if given < least:
                raise ValueError(
                    f'kd of {name} is {given:.4g} A s/rad, too little to slow a falling arm: set '
                    f'kd to at least {least:.4g}'
                )
        return gains

    def set_zero(self, zero: Array) -> None:
        """Change `zero` (n,) [rad]; the motors do not move, but computed joint angles change."""
        self.zero[:] = zero
        for joint, angle in enumerate(zero.tolist()):
            self.motors[joint].set_zero(angle)

    def switch_off(self) -> None:
        """Set currents, gains and integral terms to zero, as boards do that are off."""
        for motor in self.motors:
            motor.release()
            motor.integral = 0.0

    def wind_up(self, q: Array, duration: float) -> None:
        """Advance the estimated integral terms by `duration` [s] at mean joint angles q [rad]."""
        for joint, angle in enumerate(q.tolist()):
            self.motors[joint].wind_up(angle, duration)

    def torques(self, q: Array, dq: Array) -> Array:
        """Return the joint torques (n,) [Nm] that the boards' control laws request at q and dq."""
        speeds, motors = dq.tolist(), self.motors
        return np.array([motors[i].torque(q_i, speeds[i]) for i, q_i in enumerate(q.tolist())])

    def note_sent(self) -> None:
        """Store the motor references that this cycle's frames carry to the boards."""
        for motor in self.motors:
            motor.note_sent()

    def kept_torques(self, q: Array, dq: Array, unconfirmed: Sequence[int]) -> list[float]:
        """Return the joint torques (n,) [Nm] of boards that still use an older command.

        Parameters
        ----------
        q, dq
            (n,) joint positions [rad] and velocities [rad/s].
        unconfirmed
            n numbers of commands sent after the command that the board had used at its last
            answer. For a board that loses no command the number is 0, and the torque NaN.
        """
        if not any(unconfirmed):
            return [nan] * len(self.motors)
        angles, speeds, motors = q.tolist(), dq.tolist(), self.motors
        return [
            motors[i].kept_torque(angles[i], speeds[i], number) if number else nan
            for i, number in enumerate(unconfirmed)
        ]

    def keep_within(self, barriers: Sequence[JointBarrier], trusted: Sequence[bool]) -> bool:
        """Brake each joint whose references request more torque than its barrier allows.

        Parameters
        ----------
        trusted
            n flags as in `SafetyGate.follow`.

        Returns
        -------
        bool
            Whether a joint is braked.
        """
        motors = self.motors
        return True in [
            motors[i].keep_within(barrier) for i, barrier in enumerate(barriers) if trusted[i]
        ]

    def damp(self, speed_max: Array) -> None:
        """Damp all joints; limit currents to those that damp motor speeds (n,) [rad/s].

        A joint with speed 0, because its encoder is unreliable, gets no current.
        """
        for joint, speed in enumerate(speed_max.tolist()):
            if speed > 0.0:
                self.motors[joint].damp(speed)
            else:
                self.motors[joint].release()

    def _checked(self, name: str, gain: ArrayLike) -> Array:
        values, n = np.array(gain, dtype=float), len(self.motors)
        if values.shape not in ((), (1,), (n,)):
            raise ValueError(f'{name} has {values.size} values: set 1 or {n}')
        most = self._profile.command.largest(name)
        if not np.all((values >= 0.0) & (values <= most)):
            raise ValueError(
                f'{name} is {values}, but frames of profile {self._profile.name} can only carry '
                f'0 to {most:.4g}: set a value in this range'
            )
        return np.broadcast_to(values, (n,))
