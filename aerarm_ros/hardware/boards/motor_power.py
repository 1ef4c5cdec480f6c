"""Electrical power and energy of the motors."""

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.command_buffer import Array


class MotorPower:
    """Input power of each motor, thesis (4.1) with i_d = 0, and its integral.

    If the boards report the quadrature voltage, ``P = 3/2 u_q i_q``. Else it is the sum of
    the parts of thesis section 4.1 for constant current, Joule loss and mechanical power,
    ``P = 3/2 R i_q^2 + K_i i_q omega_m``, with the configuration's R and K_i.

    Parameters
    ----------
    config
        Resistances and torque constants.
    profile
        Tells what the boards report.

    Attributes
    ----------
    source
        'voltage' (reported) or 'model' (computed).
    watts, energy
        (n,) [W], and [J] since start; updated in place.
    """

    def __init__(self, config: ArmConfig, profile: FrameProfile) -> None:
        self.source = 'voltage' if profile.sensor.has('quadrature_voltage') else 'model'
        self.watts = np.zeros(config.n)
        self.energy = np.zeros(config.n)
        self._is_known = False  # the boards' last good state stays, so it is known for good
        self._resistance = 1.5 * config.column('motor.resistance')
        self._torque_constant = config.column('motor.torque_constant')

    def update(self, current: Array, velocity: Array, voltage: Array, dt: float) -> None:
        """Take (n,) motor currents [A], speeds [rad/s] and voltages [V], dt [s] after the last.

        While some are NaN, before the boards have answered, power and energy stay zero.
        """
        if not self._is_known:
            if np.isnan(current).any():
                return
            self._is_known = True
        if self.source == 'voltage':
            self.watts[:] = 1.5 * voltage * current
        else:
            voltage_like = self._resistance * current + self._torque_constant * velocity
            np.multiply(voltage_like, current, out=self.watts)
        self.energy += self.watts * dt
