"""From what the joints shall do to what the boards' law (4.4) is given."""

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.frame_profile import FrameProfile
from aerarm_ros.hardware.joint_command import Array, JointCommand, Mask
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

    Attributes
    ----------
    position, velocity, current, kp, kd, integral_gain
        (n,) motor side, as in `BoardCommand`: [rad], [rad/s], [A], [A/rad], [A s/rad],
        [A/(rad s)].
    zero
        (n,) angles [rad] that the boards report where the motors' angle is zero.
    joint_position
        (n,) position references at the joints [rad], NaN for a joint without one.
    """

    def __init__(self, config: ArmConfig, profile: FrameProfile, reach_max: float) -> None:
        n = config.n
        self.position, self.velocity, self.current = np.zeros(n), np.zeros(n), np.zeros(n)
        self.kp, self.kd, self.integral_gain = np.zeros(n), np.zeros(n), np.zeros(n)
        self.zero = np.zeros(n)
        self.joint_position: Array = np.full(n, np.nan)
        self._profile = profile
        self._drive = DriveTrain(config)
        self._lowest, self._highest = config.column('position_min'), config.column('position_max')
        self._effort_max = config.column('effort_max')
        self._reach_max = reach_max
        self.set_gains(config.column('board_kp'), config.column('board_kd'))

    def set_gains(self, kp: ArrayLike, kd: ArrayLike, integral_gain: ArrayLike = 0.0) -> None:
        """Set the boards' gains, motor side: (n,) or one for all, units as above.

        Raises ValueError, and changes nothing, if the frame cannot hold one of them.
        """
        gains = [
            self._checked('kp', kp),
            self._checked('kd', kd),
            self._checked('integral_gain', integral_gain),
        ]
        self._board_kp, self._board_kd, self._board_integral_gain = gains
        stiffness = np.maximum(self._drive.motor_to_joint_gain(self._board_kp), 1e-9)
        self._reach = np.minimum(self._effort_max / stiffness, self._reach_max)

    def set_zero(self, zero: Array) -> None:
        """Change `zero` (n,) [rad] without moving the motors: the joints' angles change instead."""
        self.joint_position += self._drive.motor_to_joint_velocity(self.zero - zero)
        self.zero[:] = zero

    def _checked(self, name: str, gain: ArrayLike) -> Array:
        values = np.array(gain, dtype=float)
        if values.shape not in ((), self.kp.shape):
            raise ValueError(f'{name} has {values.size} values: give 1 or {self.kp.size}')
        most = self._profile.command.largest(name)
        if not np.all((values >= 0.0) & (values <= most)):
            raise ValueError(
                f'{name} is {values}: frames of profile {self._profile.name} hold 0 to {most:.4g}'
            )
        return np.broadcast_to(values, self.kp.shape)

    def release(self) -> None:
        """Ask for nothing: no current, no gains."""
        self.position[:] = self.velocity[:] = self.current[:] = 0.0
        self.kp[:] = self.kd[:] = self.integral_gain[:] = 0.0
        self.joint_position[:] = np.nan

    def damp(self, trusted: Mask) -> None:
        """Damp the joints to rest; those whose encoder is not trusted get no current."""
        self.release()
        self.kd[:] = np.where(trusted, self._board_kd, 0.0)

    def track(self, command: JointCommand, brake: Array, q: Array, dt: float) -> None:
        """Follow a limited command.

        Parameters
        ----------
        command
            References of the joints.
        brake
            (n,) velocities to which torque-controlled joints are damped [rad/s], or NaN.
        q
            (n,) measured positions [rad].
        dt
            Time since the last call [s].
        """
        unset_position = np.isnan(command.position)
        unset_velocity = np.isnan(command.velocity)
        stiff = ~(unset_position & unset_velocity)
        velocity = np.where(unset_velocity, 0.0, command.velocity)
        start = np.where(np.isnan(self.joint_position), q, self.joint_position)
        integrated = np.minimum(np.maximum(start + velocity * dt, q - self._reach), q + self._reach)
        integrated = np.minimum(np.maximum(integrated, self._lowest), self._highest)
        reference = np.where(unset_position, integrated, command.position)
        self.joint_position[:] = np.where(stiff, reference, np.nan)
        braked = ~np.isnan(brake)
        velocity = np.where(braked, brake, velocity)
        effort = np.where(np.isnan(command.effort), 0.0, command.effort)
        drive = self._drive
        # A joint without stiffness still gets a position that any frame can hold.
        self.position[:] = drive.joint_to_motor_position(np.where(stiff, reference, q)) + self.zero
        self.velocity[:] = drive.joint_to_motor_velocity(velocity)
        self.current[:] = drive.effort_to_current(effort)
        np.multiply(self._board_kp, stiff, out=self.kp)
        np.multiply(self._board_kd, stiff | braked, out=self.kd)
        np.multiply(self._board_integral_gain, stiff, out=self.integral_gain)
