"""Direct and differential kinematics, from the URDF or the DH parameters (thesis table 2.1)."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import Array

ARM_LENGTH = 0.65
"""DH length d_3 of thesis table 2.1, from joint 2 to joint 4 [m]."""

DH_BASE_HEIGHT = 0.167
"""Height of the DH base frame above the URDF's base_link [m], thesis A.4."""

DH_TABLE = (
    # a_i, d_i, alpha_i, offset of theta_i
    (0.0, 0.0, np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, np.pi / 2),
    (0.0, ARM_LENGTH, np.pi / 2, 0.0),
    (0.0, 0.0, 0.0, 0.0),
)
"""Thesis table 2.1: a_i [m], d_i [m], alpha_i [rad] and the offset of theta_i [rad]."""


def dh_transform(a: float, d: float, alpha: float, theta: float) -> Array:
    """Return the DH transform A_i^{i-1} of thesis (2.1), the pose of frame i in frame i-1.

    Parameters
    ----------
    a, d : float
        DH lengths [m].
    alpha, theta : float
        DH angles [rad].

    Returns
    -------
    (4, 4) ndarray
        Homogeneous transformation: rotation theta about z, translation d along z, translation a
        along x, rotation alpha about x.
    """
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def dh_forward(q: npt.ArrayLike) -> Array:
    """Return T_4^0(q), the pose of the `wrist` frame in the DH base frame, thesis table 2.1.

    The DH base is parallel to the URDF's base_link, at `DH_BASE_HEIGHT` above it.

    Parameters
    ----------
    q : (4,) array_like
        Joint positions [rad].

    Returns
    -------
    (4, 4) ndarray
    """
    transform = np.eye(4)
    for (a, d, alpha, offset), angle in zip(DH_TABLE, np.asarray(q, dtype=float), strict=True):
        transform = transform @ dh_transform(a, d, alpha, angle + offset)
    return transform


class Kinematics:
    """Pose and Jacobian of one frame of an arm with n joints, computed from the URDF.

    An instance has working memory, so each thread needs its own instance.

    Parameters
    ----------
    frame : str
        Name of a link of the URDF, with or without the robot's prefix.

    Raises
    ------
    ValueError
        If the link is unknown.
    """

    def __init__(self, robot: Robot, frame: str = 'tool0') -> None:
        self._model = robot.model
        self.robot = robot
        self.frame = robot.frame_of(frame).name
        self._id = self._model.getFrameId(self.frame, pin.FrameType.BODY)
        self._data = self._model.createData()

    def transform(self, q: Array) -> Array:
        """Return the pose (4, 4) of the frame in the base frame, for q (n,) [rad]."""
        return np.asarray(self._placement(q).homogeneous)

    def position(self, q: Array) -> Array:
        """Return the position of the frame's origin in the base frame, (3,) [m]."""
        return np.array(self._placement(q).translation)

    def jacobian(self, q: Array) -> Array:
        """Return the geometric Jacobian J(q): `[v; w] = J(q) dq`.

        The twist consists of the velocity v of the frame's origin and the angular velocity w, both
        along the base's axes.

        Parameters
        ----------
        q : (n,) ndarray
            Joint positions [rad].

        Returns
        -------
        (6, n) ndarray
            Linear rows 0-2 [m], angular rows 3-5.
        """
        reference = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.asarray(pin.computeFrameJacobian(self._model, self._data, q, self._id, reference))

    def position_jacobian(self, q: Array) -> Array:
        """Return the Jacobian (3, n) [m] of the frame's position: the first three rows of J(q)."""
        return self.jacobian(q)[:3]

    def acceleration_bias(self, q: Array, dq: Array) -> Array:
        """Return `dJ/dt dq` (6,), the frame's acceleration if the joint acceleration is zero.

        The first three entries are the linear acceleration of the frame's origin [m/s^2], the
        last three the angular acceleration [rad/s^2], along the base's axes.

        Parameters
        ----------
        q, dq : (n,) ndarray
            Joint positions [rad] and velocities [rad/s].
        """
        pin.forwardKinematics(self._model, self._data, q, dq, np.zeros_like(dq))
        reference = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        motion = pin.getFrameClassicalAcceleration(self._model, self._data, self._id, reference)
        return np.array(motion.vector)

    def _placement(self, q: Array) -> Any:
        pin.framesForwardKinematics(self._model, self._data, q)
        return self._data.oMf[self._id]
