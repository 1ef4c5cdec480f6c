"""Vectors and rotations between ROS's frames and PX4's.

PX4's world is north-east-down, its body forward-right-down; ROS's are east-north-up and
forward-left-up (REP 103, REP 105).
"""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_WORLD = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_BODY = np.array([1.0, -1.0, -1.0])


def ned(vector: npt.ArrayLike) -> Array:
    """Return a vector (3,) of the east-north-up world in north-east-down; the way back too."""
    return np.asarray(_WORLD @ np.asarray(vector, dtype=float))


def frd_rotation(rotation: Array) -> Array:
    """Return the attitude (3, 3), FRD to NED, of one that turns FLU to ENU; the way back too."""
    return np.asarray((_WORLD @ rotation) * _BODY)


def heading(yaw: float) -> float:
    """Return the angle from north to the right [rad] of one from east to the left."""
    return float(np.arctan2(np.cos(yaw), np.sin(yaw)))
