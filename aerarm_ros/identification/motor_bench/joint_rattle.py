"""How far other joints' play shifts the link of a joint that swings."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.model.dynamics import Dynamics

Array = npt.NDArray[np.float64]

_PLAY = 0.05  # [rad] that a joint has at most


def rattle_of_others(
    dynamics: Dynamics, posture: Array, joint: int, amplitude: float, acceleration: float
) -> Array:
    """Return how far each joint's play shifts the link of one that swings, at most (n,) [rad].

    Links push each other: what a joint accelerates asks for torque of the others, by the inertia
    that couples them. One that gravity presses harder than that onto a flank stays there. One that
    nothing presses moves within its play, and takes the link that is watched along.

    Parameters
    ----------
    dynamics : Dynamics
        Of the arm.
    posture : (n,) ndarray
        About which the joint swings [rad].
    joint : int
        The one that swings.
    amplitude, acceleration : float
        Largest of its motion [rad], [rad/s^2].
    """
    inertia = np.abs(dynamics.inertia_matrix(posture))
    gravity = np.abs(dynamics.gravity(posture))
    coupling, own = inertia[joint], np.diag(inertia)
    moves = np.minimum(_PLAY, amplitude * coupling / own)
    shift = np.where(gravity > coupling * acceleration, 0.0, moves * coupling / own[joint])
    shift[joint] = 0.0
    return np.asarray(shift)
