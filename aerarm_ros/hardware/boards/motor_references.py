"""From what the joints shall do to what the boards' law (4.4) is given."""

from collections.abc import Sequence
from math import nan

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.motor_reference import MotorReference
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.command_buffer import Array, CommandBuffer, Mask
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier
from aerarm_ros.model.drive_train import DriveTrain


class MotorReferences:
    """References and gains of the n motors, in the joints' order.

    For a joint commanded by velocity alone the velocity is integrated into a position
    reference: with it the boards' proportional and derivative gains are the integral and
    proportional gains of the PI velocity loop, thesis (4.5). The integrated reference stays
    so close to the measured position that its share of the torque does not exceed the
    joint's effort limit (anti-windup), and within the position limits.

    Parameters
    ----------
    config
        Gains, limits and drive train.
    profile
        Says which gains the boards' frames hold.
    reach_max
        Largest distance of an integrated reference from the arm [rad].

    damping_min
        (n,) or one for all: least damping that kd may give a joint [Nms/rad], so that an arm
        that is stopped does not fall; see `JointLoads`.

    Raises
    ------
    ValueError
        If the frame cannot hold the configuration's gains, or its damping is too small.

    Attributes
    ----------
    motors
        One `MotorReference` a joint.
    zero
        (n,) angles [rad] that the boards report where the motors' angle is zero.
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
        """Kp and Kd that the boards have now, n pairs, motor side [A/rad], [A s/rad].

        Zero where the joint is controlled by torque.
        """
        return [(motor.kp, motor.kd) for motor in self.motors]

    @property
    def feed_forward(self) -> list[float]:
        """Currents, n, commanded as effort, or of a braked joint's load [A], motor side."""
        return [motor.believed for motor in self.motors]

    @property
    def braking_noise(self) -> list[float]:
        """Currents, n, that counts make of a braked joint's torque [A]; 0 where none is braked."""
        return [motor.noise for motor in self.motors]

    def set_gains(self, kp: ArrayLike, kd: ArrayLike, integral_gain: ArrayLike = 0.0) -> None:
        """Set the boards' gains, motor side: (n,) or one for all [A/rad], [A s/rad], [A/(rad s)].

        Raises ValueError, and changes nothing, if the frame cannot hold one of them or kd does
        not damp a joint.
        """
        gains = self.check_gains(kp, kd, integral_gain)
        stiffness = np.maximum(self._drive.motor_to_joint_gain(gains[0]), 1e-9)
        reach = np.minimum(self._effort_max / stiffness, self._reach_max)
        for motor, row in zip(self.motors, np.transpose([*gains, reach]).tolist(), strict=True):
            motor.set_gains(*row)

    def check_gains(
        self, kp: ArrayLike, kd: ArrayLike, integral_gain: ArrayLike = 0.0
    ) -> list[Array]:
        """Return the three gains as (n,), or raise what `set_gains` would raise."""
        named = zip(('kp', 'kd', 'integral_gain'), (kp, kd, integral_gain), strict=True)
        gains = [self._checked(name, gain) for name, gain in named]
        # What the frame makes of it counts: a field may be coarse.
        count = self._profile.command.count_of('kd')
        damping = np.round(gains[1] / count) * count
        for name, given, least in zip(
            self._names, damping.tolist(), self._kd_min.tolist(), strict=True
        ):
            if given < least:
                raise ValueError(
                    f'kd of {name} is {given:.4g} A s/rad: an arm that is stopped would fall, '
                    f'give {least:.4g} at least'
                )
        return gains

    def set_zero(self, zero: Array) -> None:
        """Change `zero` (n,) [rad] without moving the motors: the joints' angles change instead."""
        self.zero[:] = zero
        for motor, angle in zip(self.motors, zero.tolist(), strict=True):
            motor.set_zero(angle)

    def switch_off(self) -> None:
        """Ask for nothing: no current, no gains. A board that is off forgets its integral."""
        for motor in self.motors:
            motor.release()
            motor.integral = 0.0

    def wind_up(self, q: Array, duration: float) -> None:
        """Follow the boards' integrals for a time [s], with joints at q (n,) in its middle."""
        for motor, angle in zip(self.motors, q.tolist(), strict=True):
            motor.wind_up(angle, duration)

    def torques(self, q: Array, dq: Array) -> Array:
        """Return the torques (n,) [Nm] of the boards' laws for joints at q, dq (n,)."""
        rows = zip(self.motors, q.tolist(), dq.tolist(), strict=True)
        return np.array([motor.torque(angle, speed) for motor, angle, speed in rows])

    def note_sent(self) -> None:
        """Remember what the frames of this cycle said."""
        for motor in self.motors:
            motor.note_sent()

    def kept_torques(self, q: Array, dq: Array, unconfirmed: Sequence[int]) -> list[float]:
        """Return the torques, n [Nm], of boards that go on with an older command.

        Parameters
        ----------
        q, dq
            (n,) joints [rad], [rad/s].
        unconfirmed
            n numbers of commands since the one that the board used when it answered last; 0 for a
            board that loses none, whose torque is NaN.
        """
        rows = zip(self.motors, q.tolist(), dq.tolist(), unconfirmed, strict=True)
        return [
            motor.kept_torque(angle, speed, number) if number else nan
            for motor, angle, speed, number in rows
        ]

    def keep_within(self, barriers: Sequence[JointBarrier], trusted: Mask) -> bool:
        """Brake joints whose references ask for more than their barriers let pass.

        Parameters
        ----------
        barriers
            One a joint.
        trusted
            (n,) False for joints whose encoder is not believed: they have no barrier.

        Returns
        -------
        bool
            Whether a joint is braked.
        """
        rows = zip(self.motors, barriers, trusted.tolist(), strict=True)
        braked = [motor.keep_within(barrier) for motor, barrier, known in rows if known]
        return True in braked

    def damp(self, speed_max: Array) -> None:
        """Damp the joints to rest, with no more current than (n,) motor speeds ask for [rad/s].

        A joint whose speed is 0, for its encoder tells none, gets no current.
        """
        for motor, speed in zip(self.motors, speed_max.tolist(), strict=True):
            if speed > 0.0:
                motor.damp(speed)
            else:
                motor.release()

    def track(self, command: CommandBuffer, q: Array, dt: float) -> None:
        """Follow a limited command.

        Parameters
        ----------
        command
            References of the joints.
        q
            (n,) measured positions [rad].
        dt
            Time since the last call [s].
        """
        rows = zip(
            self.motors,
            command.q.tolist(),
            command.dq.tolist(),
            command.tau.tolist(),
            q.tolist(),
            strict=True,
        )
        for motor, position, velocity, effort, angle in rows:
            motor.track(position, velocity, effort, angle, dt)

    def _checked(self, name: str, gain: ArrayLike) -> Array:
        values, n = np.array(gain, dtype=float), len(self.motors)
        if values.shape not in ((), (1,), (n,)):
            raise ValueError(f'{name} has {values.size} values: give 1 or {n}')
        most = self._profile.command.largest(name)
        if not np.all((values >= 0.0) & (values <= most)):
            raise ValueError(
                f'{name} is {values}: frames of profile {self._profile.name} hold 0 to {most:.4g}'
            )
        return np.broadcast_to(values, (n,))
