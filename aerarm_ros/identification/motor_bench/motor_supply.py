"""What a motor took while its bench ran."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MotorSupply:
    """What the boards tell of one motor besides its motion.

    Attributes
    ----------
    time : (M,) ndarray
        Rising [s]; none where power is not measured.
    current, speed, power : (M,) ndarray
        Quadrature current [A], speed of the motor [rad/s], and electrical power by the voltage
        that the board reports, 3/2 u_q i_q [W].
    reported : float
        Phase resistance that the board reports [ohm]; NaN if it does not.
    """

    time: Array
    current: Array
    speed: Array
    power: Array
    reported: float = float('nan')
