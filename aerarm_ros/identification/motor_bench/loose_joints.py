"""Which joints' play would pass for that of another joint."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.model.dynamics import Dynamics

Array = npt.NDArray[np.float64]

_PLAY = 0.05  # [rad] that a joint has at most
_SHIFT = 3e-3  # [rad] that another joint's play may shift the link that is watched


def loose_joints(
    dynamics: Dynamics, posture: Array, joint: int, amplitude: float, acceleration: float
) -> list[int]:
    """Return the joints that rattle when one swings, so that its link moves with them.

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
    return [int(other) for other in np.flatnonzero(shift > _SHIFT)]
