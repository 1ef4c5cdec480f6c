"""How late measured velocities are: what filters and differences in a drive cost."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.conditioning.kinematics_filter import KinematicsFilter
from aerarm_ros.identification.conditioning.uniform_motion import UniformMotion

Array = npt.NDArray[np.float64]

# Below it a lag costs less than it is sure of: a twentieth of a period at 25 Hz.
_LEAST = 2e-3  # [s]
_CLEAR = 3.0  # standard deviations
_CORRELATION = 0.5  # periods of the cut-off that one independent sample takes


def velocity_lag(motions: Sequence[UniformMotion], cutoff: float) -> Array:
    """Return by how much measured velocities come later than the positions' derivative.

    Both through the same low-pass: a velocity that is late by e is the derivative less e times the
    acceleration, so least squares tell e, without any model of the arm.

    Parameters
    ----------
    motions : sequence of UniformMotion
        Of one arm.
    cutoff : float
        Of the low-pass [Hz].

    Returns
    -------
    (n,) ndarray
        [s]; 0 where velocities were not measured, or the lag is too small to matter or to tell.
    """
    n = motions[0].q.shape[1]
    if any(motion.dq is None for motion in motions):
        return np.zeros(n)
    products, squares, left, duration = (np.zeros(n) for _ in range(4))
    for motion in motions:
        _, derivative, ddq = KinematicsFilter(cutoff, from_position=True).apply(motion)
        _, measured, _ = KinematicsFilter(cutoff).apply(motion)
        difference = derivative - measured
        products += (difference * ddq).sum(axis=0)
        squares += (ddq**2).sum(axis=0)
        left += (difference**2).sum(axis=0)
        duration += motion.count * motion.dt
    lag = products / np.maximum(squares, 1e-300)
    left = np.maximum(left - lag * products, 0.0)
    independent = np.maximum(duration * cutoff / _CORRELATION, 1.0)
    deviation = np.sqrt(left / independent / np.maximum(squares, 1e-300))
    return np.where((np.abs(lag) < _LEAST) | (np.abs(lag) < _CLEAR * deviation), 0.0, lag)
