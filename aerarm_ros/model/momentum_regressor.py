"""The last link's torques by its inertial parameters, without joint accelerations."""

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import inertia_about_origin

Array = npt.NDArray[np.float64]


class MomentumRegressor:
    """What a body on the last link asks of the joints, as `tau = d/dt(Y_p pi) + Y_f pi`.

    With the link's Jacobian `J`, its twist `v` and its momentum `h = I v = A(v) pi`, all in the
    frame of its joint, the momentum that the joints feel is `J^T h`, and::

        tau = d/dt(J^T h) - (dJ/dt + v x J)^T h + J^T A(s) pi

    where `s` is the specific force of the base. Neither the joints' acceleration nor the base's
    angular one is in it, so that a filter of both sides needs no derivative of anything measured
    (Slotine, Li: On the adaptive control of robot manipulators, 1987).

    Made for a 1 kHz loop: arguments are not checked. An instance holds working memory: use one a
    thread.

    Parameters
    ----------
    robot : Robot
        Only its kinematics matter.
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._last = self._model.njoints - 1
        self._momentum = _momentum_tensor().reshape(6, 60)
        self._cross = _cross_tensor().reshape(6, 36)
        self._twist = np.zeros(6)
        self._felt = np.zeros(6)

    def evaluate(
        self, q: Array, dq: Array, specific_force: Array, angular_velocity: Array
    ) -> tuple[Array, Array]:
        """Return Y_p and Y_f of one state.

        Parameters
        ----------
        q, dq : (n,) ndarray
            [rad], [rad/s]
        specific_force, angular_velocity : (3,) ndarray
            Of the base, in its axes [m/s^2], [rad/s]; at rest `-gravity` and zero.

        Returns
        -------
        momentum, force : (n, 10) ndarray
            Momentum [Nms] and torque [Nm] per inertial parameter (3.3).
        """
        data, last = self._data, self._last
        pin.computeJointJacobiansTimeVariation(self._model, data, q, dq)
        jacobian = pin.getJointJacobian(self._model, data, last, pin.LOCAL)
        rate = pin.getJointJacobianTimeVariation(self._model, data, last, pin.LOCAL)
        place = data.oMi[last]
        to_link = place.rotation.T
        x, y, z = angular_velocity
        at_x, at_y, at_z = place.translation
        # The base's twist, without a velocity of its origin: that is felt in no frame.
        twist = self._twist
        twist[:3] = to_link @ (y * at_z - z * at_y, z * at_x - x * at_z, x * at_y - y * at_x)
        twist[3:] = to_link @ angular_velocity
        twist += jacobian @ dq
        self._felt[:3] = to_link @ specific_force
        momentum = (twist @ self._momentum).reshape(6, 10)
        weight = (self._felt @ self._momentum).reshape(6, 10)
        turned = rate + (twist @ self._cross).reshape(6, 6) @ jacobian
        return jacobian.T @ momentum, jacobian.T @ weight - turned.T @ momentum


def _momentum_tensor() -> Array:
    """Return A as a (6, 6, 10) tensor: momentum by twist and parameter."""
    tensor = np.zeros((6, 6, 10))
    tensors = inertia_about_origin(np.eye(10))
    cross = _cross_matrices()
    for axis in range(3):
        tensor[axis, axis, 0] = 1.0
        # A turning first moment: omega x mc; a moving one: mc x v.
        tensor[3 + axis, :3, 1:4] = cross[axis]
        tensor[axis, 3:, 1:4] = -cross[axis]
        tensor[3 + axis, 3:, 4:] = tensors[4:, :, axis].T
    return tensor


def _cross_tensor() -> Array:
    """Return the cross product of twists as a (6, 6, 6) tensor: `v x` by the twist v."""
    tensor = np.zeros((6, 6, 6))
    for axis, matrix in enumerate(_cross_matrices()):
        tensor[axis, :3, 3:] = matrix
        tensor[3 + axis, :3, :3] = tensor[3 + axis, 3:, 3:] = matrix
    return tensor


def _cross_matrices() -> Array:
    """Return S(a) of `S(a) b = a x b` for the three axes a, (3, 3, 3)."""
    return np.stack([np.cross(axis, np.eye(3)).T for axis in np.eye(3)])
