"""From an autopilot's frames to those of ROS.

PX4 and ArduPilot use north-east-down for the world and forward-right-down for the body; ROS
uses east-north-up and forward-left-up (REP 103, REP 105). MAVROS converts by itself.

Quaternions are (x, y, z, w), as in ROS messages, and rotate from body to world.
"""

import numpy as np
import numpy.typing as npt
import pinocchio as pin

Array = npt.NDArray[np.float64]

_HALF = np.sqrt(0.5)
# Body: half a turn about x. World: x and y swapped, z turned over.
_FLU_IN_FRD = np.array([1.0, 0.0, 0.0, 0.0])
_NED_IN_ENU = np.array([_HALF, _HALF, 0.0, 0.0])


def frd_to_flu(vector: npt.ArrayLike) -> Array:
    """Return a body vector (3,) in forward-left-up axes; the way back is the same."""
    return np.asarray(vector, dtype=float) * (1.0, -1.0, -1.0)


def attitude_ned_frd_to_enu_flu(quaternion: npt.ArrayLike) -> Array:
    """Return the attitude (4,) of a forward-left-up body in an east-north-up world.

    Parameters
    ----------
    quaternion : (4,) array_like
        Attitude (x, y, z, w) of the forward-right-down body in the north-east-down world.
    """
    q = np.asarray(quaternion, dtype=float)
    return quaternion_product(quaternion_product(_NED_IN_ENU, q), _FLU_IN_FRD)


def quaternion_product(a: Array, b: Array) -> Array:
    """Return the Hamilton product a b of (x, y, z, w) quaternions: first b turns, then a."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def rotation_matrix(quaternion: Array) -> Array:
    """Return the (3, 3) matrix of a unit quaternion (x, y, z, w)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    return np.array(pin.Quaternion(rotation).coeffs())
