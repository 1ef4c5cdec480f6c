"""Direct and differential kinematics."""

from typing import Any

import numpy as np
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.motion.signals import Array


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
