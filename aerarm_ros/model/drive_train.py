"""Conversion between joints and motors: gears, signs, offsets and torque constants."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig, torque_constant
from aerarm_ros.motion.signals import Array

__all__ = ['DriveTrain', 'torque_constant']


class DriveTrain:
    """Conversion between joint and motor quantities, thesis (4.2), (4.6), (4.7).

    All arrays are (n,) or (..., n), in the order of `config.joint_names`. With the sign `s` and the
    offset `o` of a joint::

        q = s k_g theta_m + o        dq = s k_g dtheta_m        tau = s (K_i eta / k_g) i_q

    Attributes
    ----------
    reflected_inertia : (n,) ndarray
        Rotor inertia reflected to each joint, J_m / k_g^2 [kg m^2].
    """

    def __init__(self, config: ArmConfig) -> None:
        signs = config.column('sign')
        self._joint_per_motor = signs * config.column('gear.ratio')
        self._motor_per_joint = 1.0 / self._joint_per_motor
        self._offset = config.column('offset')
        self._effort_per_current = signs * config.column('torque_per_ampere')
        self._current_per_effort = 1.0 / self._effort_per_current
        # A gain relates a current to a motor angle; both change sign with the joint's sign, so
        # the gain has none.
        self._joint_gain_per_motor_gain = self._effort_per_current / self._joint_per_motor
        self.reflected_inertia = config.column('reflected_inertia')

    def motor_to_joint_position(self, motor_position: Array) -> Array:
        """Return the joint positions [rad] for motor positions [rad]."""
        return self._joint_per_motor * motor_position + self._offset

    def joint_to_motor_position(self, q: Array) -> Array:
        """Return the motor positions [rad] for joint positions [rad]."""
        return (q - self._offset) * self._motor_per_joint

    def motor_to_joint_velocity(self, motor_velocity: Array) -> Array:
        """Return the joint velocities [rad/s] for motor velocities [rad/s], thesis (4.6)."""
        return self._joint_per_motor * motor_velocity

    def joint_to_motor_velocity(self, dq: Array) -> Array:
        """Return the motor velocities [rad/s] for joint velocities [rad/s], thesis (4.6)."""
        return self._motor_per_joint * dq

    def current_to_effort(self, current: Array) -> Array:
        """Return the joint torques [Nm] for quadrature currents [A], thesis (4.2), (4.7)."""
        return self._effort_per_current * current

    def effort_to_current(self, effort: Array) -> Array:
        """Return the quadrature currents [A] for joint torques [Nm], thesis (4.2), (4.7)."""
        return self._current_per_effort * effort

    def motor_to_joint_gain(self, gain: Array) -> Array:
        """Return joint gains for board gains (4.4).

        Board gains in [A/rad] and [A s/rad] become joint gains in [Nm/rad] and [Nms/rad].
        """
        return self._joint_gain_per_motor_gain * gain

    def joint_to_motor_gain(self, gain: Array) -> Array:
        """Return board gains (4.4) for joint gains: the inverse of `motor_to_joint_gain`."""
        return gain / self._joint_gain_per_motor_gain


def viscous_coulomb(dq: Array, fv: Array, fs: Array) -> Array:
    """Return the friction torque `fv dq + fs sgn(dq)`, thesis (2.6).

    Friction opposes motion when subtracted from the drive's torque, as in (2.7).

    Parameters
    ----------
    dq : (..., n) ndarray
        Joint velocities [rad/s].
    fv, fs : (n,) ndarray, or (..., n) where they vary
        Viscous [Nms/rad] and Coulomb [Nm] friction.

    Returns
    -------
    (..., n) ndarray
        Friction torque [Nm].
    """
    torque: Array = fv * dq + fs * np.sign(dq)
    return torque
