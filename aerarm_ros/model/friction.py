"""Joint friction, thesis (2.6)."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def viscous_coulomb(dq: Array, fv: Array, fs: Array) -> Array:
    """Return the friction torque `fv dq + fs sgn(dq)`, thesis (2.6).

    It opposes motion when subtracted from the drive's torque, as in (2.7).

    Parameters
    ----------
    dq : (..., n) ndarray
        Joint velocities [rad/s].
    fv, fs : (n,) ndarray, or (..., n) where they vary
        Viscous [Nms/rad] and Coulomb [Nm] friction.

    Returns
    -------
    (..., n) ndarray
        [Nm]
    """
    torque: Array = fv * dq + fs * np.sign(dq)
    return torque
