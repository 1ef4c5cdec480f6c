"""A base that responds, and joint motions on it, by the whole mass matrix."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics

Array = npt.NDArray[np.float64]

RATE, WRENCH = np.array([0.4, -0.7, 0.5]), np.array([1.0, -2.0, -30.0, 0.5, -0.4, 0.3])


def answering_base() -> FreeBaseMotion:
    """Return a base that rotates, is pushed, and is predicted with full weight."""
    return FreeBaseMotion(
        BaseMotion(np.zeros(3), np.zeros(3), RATE, np.zeros(3)), WRENCH, np.ones(6)
    )


def joint_acceleration(dynamics: MovingBaseDynamics, q: Array, dq: Array, tau: Array) -> Array:
    """Return the joints' acceleration (n,) [rad/s^2] under torques, on `answering_base`."""
    whole = dynamics.whole
    bias = whole.forces(q, dq, np.zeros(dynamics.n), RATE)
    applied = np.concatenate([WRENCH, tau])
    return np.linalg.solve(whole.inertia_matrix(q), applied - bias)[6:]
