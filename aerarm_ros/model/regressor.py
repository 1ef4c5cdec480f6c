"""Regressor of the dynamic model, which is linear in the dynamic parameters."""

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import PARAMETER_NAMES, inertia_about_origin
from aerarm_ros.motion.signals import Array


class Regressor:
    """Regressor Phi of an arm: `tau = Phi(q, dq, ddq) theta`, thesis (3.1), (3.6).

    The columns are the ten inertial parameters of each link (3.3), then viscous friction `fv` and
    Coulomb friction `fs` of each joint (3.5). The columns of rotor inertia `Ja` at the joints [kg
    m^2], which the thesis omits, are optional. The packaged arm has 48 columns without rotor
    inertia, and 52 with it.

    An instance has working memory, so use one per thread.

    Parameters
    ----------
    robot : Robot
        Robot with n joints; only its kinematics and gravity are used.
    rotor_inertia : bool
        Whether to append the columns `Ja`.

    Attributes
    ----------
    columns : tuple of str
        Name of each column, for example 'm_link1', 'fv_joint1', 'Ja_joint4'.
    """

    def __init__(self, robot: Robot, rotor_inertia: bool = False) -> None:
        self.robot = robot
        self.rotor_inertia = rotor_inertia
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self.columns = self._column_names()

    def stack_rigid(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> Array:
        """Return the regressors of the inertial parameters for M samples, one below the other.

        Parameters
        ----------
        q, dq, ddq : (M, n) array_like
            Positions [rad], velocities [rad/s], accelerations [rad/s^2].

        Returns
        -------
        (M, n, 10 n) ndarray

        Raises
        ------
        ValueError
            If a shape is wrong.
        """
        q, dq, ddq = self._samples(q, dq, ddq)
        stacked = np.empty((len(q), self.robot.n, 10 * self.robot.n))
        self._fill_rigid(stacked, q, dq, ddq)
        return stacked

    def stack(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> Array:
        """Return the complete regressors for M samples, one below the other, thesis (3.6), (3.8).

        Parameters
        ----------
        q, dq, ddq : (M, n) array_like
            Positions [rad], velocities [rad/s], accelerations [rad/s^2].

        Returns
        -------
        (M n, p) ndarray
            Rows sample by sample, matching `tau.reshape(-1)` of (M, n) torques; columns as in
            `columns`.

        Raises
        ------
        ValueError
            If a shape is wrong.
        """
        q, dq, ddq = self._samples(q, dq, ddq)
        n = self.robot.n
        stacked = np.zeros((len(q), n, len(self.columns)))
        self._fill_rigid(stacked[:, :, : 10 * n], q, dq, ddq)
        diagonals = [dq, np.sign(dq)] + ([ddq] if self.rotor_inertia else [])
        joint = np.arange(n)
        for block, values in enumerate(diagonals):
            stacked[:, joint, (10 + block) * n + joint] = values
        return stacked.reshape(-1, len(self.columns))

    def parameters(
        self,
        inertial: npt.ArrayLike,
        viscous: npt.ArrayLike,
        coulomb: npt.ArrayLike,
        rotor_inertia: npt.ArrayLike | None = None,
    ) -> Array:
        """Return the parameter vector theta in the order of `columns`, thesis (3.5).

        Parameters
        ----------
        inertial : (n, 10) array_like
            Inertial parameters, thesis (3.3).
        viscous, coulomb : (n,) array_like
            Viscous [Nms/rad] and Coulomb [Nm] friction.
        rotor_inertia : (n,) array_like, optional
            Inertia at the joints [kg m^2]; required if and only if the regressor has its columns.

        Returns
        -------
        (p,) ndarray

        Raises
        ------
        ValueError
            If a shape is wrong, or `rotor_inertia` does not match the columns.
        """
        if (rotor_inertia is not None) != self.rotor_inertia:
            state, give = ('has', 'give') if self.rotor_inertia else ('has no', 'omit')
            raise ValueError(
                f'this regressor {state} columns for rotor inertia: {give} rotor_inertia'
            )
        joint_parts = [viscous, coulomb] + ([] if rotor_inertia is None else [rotor_inertia])
        parts = [np.asarray(part, dtype=float) for part in (inertial, *joint_parts)]
        n = self.robot.n
        if parts[0].shape != (n, 10) or any(part.shape != (n,) for part in parts[1:]):
            shapes = [part.shape for part in parts]
            raise ValueError(f'parameters have the shapes {shapes}, but the arm has {n} joints')
        return np.concatenate([part.ravel() for part in parts])

    def _fill_rigid(self, out: Array, q: Array, dq: Array, ddq: Array) -> None:
        regressor, model, data = pin.computeJointTorqueRegressor, self._model, self._data
        for row, position, velocity, acceleration in zip(out, q, dq, ddq, strict=True):
            row[...] = regressor(model, data, position, velocity, acceleration)

    def _samples(self, *arrays: npt.ArrayLike) -> list[Array]:
        samples = [np.ascontiguousarray(array, dtype=float) for array in arrays]
        shape = samples[0].shape
        if len(shape) != 2 or shape[1] != self.robot.n or any(s.shape != shape for s in samples):
            raise ValueError(
                f'q, dq and ddq have the shapes {[s.shape for s in samples]}, but must have the '
                f'shape (samples, {self.robot.n})'
            )
        return samples

    def _column_names(self) -> tuple[str, ...]:
        links = [f'{name}_{link}' for link in self.robot.link_names for name in PARAMETER_NAMES]
        kinds = ('fv', 'fs', 'Ja') if self.rotor_inertia else ('fv', 'fs')
        return (*links, *(f'{kind}_{j}' for kind in kinds for j in self.robot.joint_names))


class MomentumRegressor:
    """Regressor of the joint torques of a body on the last link: `tau = d/dt(Y_p pi) + Y_f pi`.

    With the link's Jacobian `J`, its twist `v` and its momentum `h = I v = A(v) pi`, all in the
    frame of its joint, the generalized momentum of the joints is `J^T h`, and::

        tau = d/dt(J^T h) - (dJ/dt + v x J)^T h + J^T A(s) pi

    where `s` is the specific force of the base. Accelerations of the joints and angular
    acceleration of the base do not appear. If both sides are filtered, no measured signal must
    therefore be differentiated (Slotine, Li: On the adaptive control of robot manipulators,
    1987).

    Intended for a 1 kHz loop: arguments are not checked. An instance has working memory, so use one
    per thread.

    Parameters
    ----------
    robot : Robot
        Robot of which only the kinematics are used.
    """

    def __init__(self, robot: Robot) -> None:
        self._model = robot.model.copy()
        self._data = self._model.createData()
        self._last = self._model.njoints - 1
        self._momentum = _momentum_tensor().reshape(6, 60)
        self._cross = _cross_tensor().reshape(6, 36)
        self._twist = np.zeros(6)
        self._specific_force = np.zeros(6)

    def evaluate(
        self, q: Array, dq: Array, specific_force: Array, angular_velocity: Array
    ) -> tuple[Array, Array]:
        """Return the regressors Y_p and Y_f of `tau = d/dt(Y_p pi) + Y_f pi` for one state.

        Parameters
        ----------
        q, dq : (n,) ndarray
            Joint positions [rad] and velocities [rad/s].
        specific_force, angular_velocity : (3,) ndarray
            Specific force [m/s^2] and angular velocity [rad/s] of the base, in its axes; at rest
            `-gravity` and zero.

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
        # Twist of the base without linear velocity, which has no effect in any frame.
        twist = self._twist
        twist[:3] = to_link @ (y * at_z - z * at_y, z * at_x - x * at_z, x * at_y - y * at_x)
        twist[3:] = to_link @ angular_velocity
        twist += jacobian @ dq
        self._specific_force[:3] = to_link @ specific_force
        momentum = (twist @ self._momentum).reshape(6, 10)
        weight = (self._specific_force @ self._momentum).reshape(6, 10)
        turned = rate + (twist @ self._cross).reshape(6, 6) @ jacobian
        return jacobian.T @ momentum, jacobian.T @ weight - turned.T @ momentum


def _momentum_tensor() -> Array:
    """Return the tensor A (6, 6, 10) that maps twist and inertial parameters to momentum."""
    tensor = np.zeros((6, 6, 10))
    tensors = inertia_about_origin(np.eye(10))
    cross = _cross_matrices()
    for axis in range(3):
        tensor[axis, axis, 0] = 1.0
        # Contribution of the first moment: omega x mc for rotation, mc x v for translation.
        tensor[3 + axis, :3, 1:4] = cross[axis]
        tensor[axis, 3:, 1:4] = -cross[axis]
        tensor[3 + axis, 3:, 4:] = tensors[4:, :, axis].T
    return tensor


def _cross_tensor() -> Array:
    """Return the tensor (6, 6, 6) that maps a twist v to the matrix `v x` of its cross product."""
    tensor = np.zeros((6, 6, 6))
    for axis, matrix in enumerate(_cross_matrices()):
        tensor[axis, :3, 3:] = matrix
        tensor[3 + axis, :3, :3] = tensor[3 + axis, 3:, 3:] = matrix
    return tensor


def _cross_matrices() -> Array:
    """Return the matrices S(a) with `S(a) b = a x b` for the three unit vectors a, (3, 3, 3)."""
    return np.stack([np.cross(axis, np.eye(3)).T for axis in np.eye(3)])


def viscous_coulomb(dq: Array, fv: Array, fs: Array) -> Array:
    """Return the friction torque `fv dq + fs sgn(dq)`, thesis (2.6).

    Friction opposes motion when subtracted from the drive's torque, as in (2.7).

    Parameters
    ----------
    dq : (..., n) ndarray
        Joint velocities [rad/s].
    fv, fs : (n,) ndarray, or (..., n) where they vary
        Viscous [Nms/rad] and Coulomb [Nm] friction.

    Returns
    -------
    (..., n) ndarray
        Friction torque [Nm].
    """
    torque: Array = fv * dq + fs * np.sign(dq)
    return torque
