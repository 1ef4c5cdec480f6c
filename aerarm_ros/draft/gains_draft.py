"""Gains of the boards that damp an arm in every posture."""

import math

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics

Array = npt.NDArray[np.float64]

_POSTURES = 200
# The boards measure speed behind a low-pass of 100 Hz: a velocity loop (4.5) of less than half of
# it is damped, and 0.4 leaves something for links that are lighter than drawn.
_BANDWIDTH = 0.4 * 2.0 * math.pi * 100.0  # [1/s]
_BANDWIDTH_MAX = 0.5 / 0.4 * _BANDWIDTH
_FASTEST_RATE = 25.0  # [1/s] at which positions are corrected
_AMPLE = 1.1  # of the least damping, which frames round


def draft_gains(robot: Robot, rotor_inertia: Array, damping_min: Array) -> tuple[Array, Array]:
    """Return stiffness K [Nm/rad] and damping D [Nms/rad] of n joints, (n,) each.

    With M(q) the inertia, D is as large as lets all eigenvalues of M^-1 D stay below the
    bandwidth in every posture tried, and K = r D with r at most a quarter of the smallest: then
    M ddq + D dq + K q = 0 does not overshoot.

    Parameters
    ----------
    robot
        The arm as drawn.
    rotor_inertia
        (n,) reflected to the joints [kg m^2].
    damping_min
        (n,) least damping of an arm that is stopped [Nms/rad], see `JointLoads`.

    Raises
    ------
    ValueError
        If no damping is both enough and slow enough, as with links that weigh nothing.
    """
    dynamics = Dynamics(robot, rotor_inertia)
    low, high = np.maximum(robot.position_min, -math.pi), np.minimum(robot.position_max, math.pi)
    postures = np.random.default_rng(0).uniform(low, high, (_POSTURES, robot.n))
    mobility: Array = np.array([dynamics.mobility_matrix(q) for q in postures])
    shares = 1.0 / np.diagonal(mobility, axis1=1, axis2=2).max(axis=0)
    damping = shares * _BANDWIDTH / _rates(mobility, shares)[1]
    damping = np.maximum(damping, _AMPLE * damping_min)
    slowest, fastest = _rates(mobility, damping)
    if fastest > _BANDWIDTH_MAX:
        raise ValueError(
            f'an arm that is damped enough not to fall would have a velocity loop of '
            f'{fastest / (2.0 * math.pi):.0f} Hz, more than boards can: check the masses and '
            'inertias of the last links, and velocity limits'
        )
    return min(_FASTEST_RATE, 0.25 * slowest) * damping, damping


def _rates(mobility: Array, damping: Array) -> tuple[float, float]:
    """Return the smallest and the largest eigenvalue of M^-1 D over all postures [1/s]."""
    root = np.sqrt(damping)
    rates = np.linalg.eigvalsh(root[:, None] * mobility * root)
    return float(rates.min()), float(rates.max())
