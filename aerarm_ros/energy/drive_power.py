"""What the motors take from their supply, and give back."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.motion.float_array import FloatArray


class DrivePower:
    """Electrical power of n drives by the torque and velocity of their joints, thesis (4.1).

    With a quadrature current alone a motor takes ``3/2 R i^2 + K_i i omega_m``: copper loss and
    the power of its shaft, of which a gear with an efficiency below one passes on a part. While
    that sum is negative the motor brakes; of this the power stage lets the supply take back a
    share, and burns the rest.

    Arguments are (..., n) arrays: torques of the drives at the joints [Nm], as in `joint_states`,
    and velocities [rad/s].

    Parameters
    ----------
    config : ArmConfig

    Attributes
    ----------
    copper_per_torque2 : (n,) ndarray
        Copper loss over the torque squared [W/Nm^2].
    shaft : (n,) ndarray
        Power of the shaft over that of the joint, 1 / eta [-].
    recovery : float
        Share of the braking power that the supply takes back.
    """

    def __init__(self, config: ArmConfig) -> None:
        per_ampere = config.column('torque_per_ampere')
        self.copper_per_torque2 = 1.5 * config.column('motor.resistance') / per_ampere**2
        self.shaft = 1.0 / config.column('gear.efficiency')
        self.recovery = config.power_stage.recovery

    def copper(self, tau: FloatArray) -> FloatArray:
        """Return the copper loss [W]."""
        loss: FloatArray = self.copper_per_torque2 * tau**2
        return loss

    def electrical(self, tau: FloatArray, dq: FloatArray) -> FloatArray:
        """Return the power into the motors [W], negative where they brake."""
        power: FloatArray = self.copper(tau) + self.shaft * tau * dq
        return power

    def from_supply(self, electrical: npt.ArrayLike) -> FloatArray:
        """Return what the supply gives for electrical powers [W], negative for what it takes."""
        power = np.asarray(electrical, dtype=float)
        return np.where(power < 0.0, self.recovery * power, power)
