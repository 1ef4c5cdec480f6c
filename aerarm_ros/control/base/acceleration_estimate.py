"""Acceleration from measured velocity, or any other rate from a measured vector."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import positive

Array = npt.NDArray[np.float64]


class AccelerationEstimate:
    """Derivative of the velocity, through a first-order low-pass.

    Parameters
    ----------
    n : int
        Number of joints, or of axes.
    cutoff : float
        [Hz]; the estimate lags by 1 / (2 pi cutoff).

    Raises
    ------
    ValueError
        If the cutoff isn't positive.
    """

    def __init__(self, n: int, cutoff: float = 20.0) -> None:
        self._time_constant = 1.0 / (2.0 * np.pi * positive('cutoff', cutoff))
        self._smooth: Array | None = None
        self._rest = np.zeros(n)

    def reset(self) -> None:
        """Forget the past; the next velocity starts anew."""
        self._smooth = None

    def update(self, dq: Array, dt: float) -> Array:
        """Return ddq (n,) [rad/s^2] after a cycle of `dt` [s] with velocity `dq` [rad/s]."""
        if self._smooth is None:
            self._smooth = np.array(dq)
            return self._rest
        ddq: Array = (dq - self._smooth) / (self._time_constant + dt)
        self._smooth = self._smooth + dt * ddq
        return ddq
