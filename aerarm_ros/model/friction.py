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
    fv, fs : (n,) ndarray
        Viscous [Nms/rad] and Coulomb [Nm] friction.

    Returns
    -------
    (..., n) ndarray
        [Nm]
    """
    torque: Array = fv * dq + fs * np.sign(dq)
    return torque


def smooth_viscous_coulomb(dq: Array, fv: Array, fs: Array, width: float) -> Array:
    """Return (2.6) with the step replaced by `tanh(dq / width)`.

    A controller that compensates friction needs this: with the step, a velocity that is
    noise about zero makes it chatter.

    Parameters
    ----------
    dq : (..., n) ndarray
        Joint velocities [rad/s].
    fv, fs : (n,) ndarray
        Viscous [Nms/rad] and Coulomb [Nm] friction.
    width : float
        Velocity [rad/s] at which three quarters of the Coulomb friction are reached.

    Returns
    -------
    (..., n) ndarray
        [Nm]

    Raises
    ------
    ValueError
        If `width` isn't positive.
    """
    if not width > 0.0:
        raise ValueError(f'width = {width} must be positive [rad/s]')
    torque: Array = fv * dq + fs * np.tanh(dq / width)
    return torque
