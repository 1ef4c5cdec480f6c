"""Inverse and forward dynamics of an arm, thesis (2.5)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import checked_body
from aerarm_ros.motion.signals import Array


class LastLink:
    """Last body of a Pinocchio model, which can carry a payload.

    Parameters
    ----------
    model : pin.Model
        Model, which is changed in place.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        self._own = pin.Inertia(model.inertias[model.njoints - 1])

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a payload to the link, replacing any previous one; see `Dynamics.carry`."""
        whole = self._own.toDynamicParameters() + checked_payload(payload)
        self._model.inertias[self._model.njoints - 1] = pin.Inertia.FromDynamicParameters(whole)


def checked_payload(payload: npt.ArrayLike) -> Array:
    """Check a payload's inertial parameters (10,); raises ValueError if they are impossible."""
    return checked_body('payload', payload, 'pass the ten inertial parameters of payload.yaml')


class Dynamics:
    """Rigid dynamics `B(q) ddq + C(q, dq) dq + g(q) = xi` of n joints, thesis (2.5).

    The rotors turn 1/k_g times faster than the joints; their inertia J_m / k_g^2 is added to the
    diagonal of B. Gyroscopic effects of the rotors are neglected. Friction is not included.

    Intended for a 1 kHz loop: arguments are (n,) float arrays, and only their length is checked.
    An instance has working memory, so each thread needs its own instance.

    Parameters
    ----------
    rotor_inertia : float or (n,) array_like
        Rotor inertia at the joints [kg m^2], for example `DriveTrain.reflected_inertia`.

    Raises
    ------
    ValueError
        If a rotor inertia is negative or not finite, or their number is not n.
    """

    def __init__(self, robot: Robot, rotor_inertia: npt.ArrayLike = 0.0) -> None:
        self.robot = robot
        self._model = robot.model.copy()
        # Pinocchio includes the armature (rotor inertia) in rnea, crba and aba.
        self._rotor_inertia = checked_rotor_inertia(rotor_inertia, robot.n)
        self._rotor_inertia.flags.writeable = False
        self._model.armature = self._rotor_inertia
        self._data = self._model.createData()
        self._last_link = LastLink(self._model)

    @property
    def rotor_inertia(self) -> Array:
        """Rotor inertia (n,) on the joint side [kg m^2], read-only."""
        return self._rotor_inertia

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a payload to the last link, replacing any previous one.

        Parameters
        ----------
        payload : (10,) array_like
            Inertial parameters (3.3) in the frame of the last link's joint; zeros for no payload.

        Raises
        ------
        ValueError
            If the parameters are physically impossible.
        """
        self._last_link.carry(payload)

    def inertia_matrix(self, q: Array) -> Array:
        """Return the inertia matrix B(q), (n, n) [kg m^2], symmetric, including rotors."""
        return np.asarray(pin.crba(self._model, self._data, q))

    def mobility_matrix(self, q: Array) -> Array:
        """Return the inverse inertia matrix B(q)^-1, (n, n) [1/(kg m^2)], symmetric."""
        return np.asarray(pin.computeMinverse(self._model, self._data, q))

    def coriolis_matrix(self, q: Array, dq: Array) -> Array:
        """Return the matrix C(q, dq), (n, n) [Nms/rad], for which dB/dt - 2 C is skew-symmetric."""
        return np.asarray(pin.computeCoriolisMatrix(self._model, self._data, q, dq))

    def gravity(self, q: Array) -> Array:
        """Return the gravity torques g(q), (n,) [Nm]."""
        return np.asarray(pin.computeGeneralizedGravity(self._model, self._data, q))

    def bias(self, q: Array, dq: Array) -> Array:
        """Return Coriolis, centrifugal and gravity torques C(q, dq) dq + g(q), (n,) [Nm]."""
        return np.asarray(pin.nonLinearEffects(self._model, self._data, q, dq))

    def inverse(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torques [Nm] of a motion by the recursive Newton-Euler algorithm.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            Positions [rad], velocities [rad/s], accelerations [rad/s^2].

        Returns
        -------
        (n,) ndarray
            Torques xi of (2.5) [Nm], including rotors.
        """
        return np.asarray(pin.rnea(self._model, self._data, q, dq, ddq))

    def inverse_with_slopes(
        self, q: Array, dq: Array, ddq: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return the result of `inverse`, and its derivatives by q, dq and ddq.

        Returns
        -------
        xi : (n,) ndarray
            Torques [Nm].
        by_q, by_dq, by_ddq : (n, n) ndarray
            Derivatives of row i's torque by column j's position [Nm/rad], velocity [Nms/rad] and
            acceleration [kg m^2]; the last is B(q). These arrays are working memory, which the next
            call overwrites.
        """
        by_q, by_dq, by_ddq = pin.computeRNEADerivatives(self._model, self._data, q, dq, ddq)
        return self._data.tau, by_q, by_dq, by_ddq

    def forward(self, q: Array, dq: Array, tau: Array) -> Array:
        """Return the joint accelerations [rad/s^2] that torques cause (forward dynamics).

        Parameters
        ----------
        q, dq, tau : (n,) ndarray
            Positions [rad], velocities [rad/s] and torques [Nm]; `tau` is xi of (2.5), the drive's
            torque minus friction.

        Returns
        -------
        (n,) ndarray
            Accelerations [rad/s^2].
        """
        return np.asarray(pin.aba(self._model, self._data, q, dq, tau))

    def kinetic_energy(self, q: Array, dq: Array) -> float:
        """Return the kinetic energy `dq^T B(q) dq / 2` [J], including rotors."""
        return float(0.5 * dq @ self.inertia_matrix(q) @ dq)

    def potential_energy(self, q: Array) -> float:
        """Return the potential energy of gravity [J], up to a constant."""
        return float(pin.computePotentialEnergy(self._model, self._data, q))


def checked_rotor_inertia(rotor_inertia: npt.ArrayLike, n: int) -> Array:
    """Return n rotor inertias [kg m^2], given one value for all joints or n values.

    Raises
    ------
    ValueError
        If a value is negative or not finite, or their number is neither 1 nor n.
    """
    inertia = np.asarray(rotor_inertia, dtype=float)
    if inertia.shape not in ((), (n,)):
        raise ValueError(
            f'{inertia.size} rotor inertias for {n} joints: give one value, or one per joint'
        )
    if not np.all(np.isfinite(inertia) & (inertia >= 0.0)):
        raise ValueError(f'rotor inertias {inertia} must be finite and not negative [kg m^2]')
    return np.broadcast_to(inertia, (n,)).copy()


GRAVITY = 9.81
"""Gravitational acceleration [m/s^2]."""
_POSTURES = 500


def largest_gravity_load(robot: Robot) -> Array:
    """Return each joint's largest gravity torque, over all postures and directions of gravity.

    The maximum over directions is exact, the maximum over postures uses samples within the joint
    limits.

    Returns
    -------
    (n,) ndarray
        Non-negative torques [Nm].
    """
    model = robot.model.copy()
    data = model.createData()
    random = np.random.default_rng(0)
    postures = random.uniform(*robot.posture_range, (_POSTURES, robot.n))
    along_axes = []
    for direction in np.eye(3):
        model.gravity.linear = GRAVITY * direction
        along_axes.append([pin.computeGeneralizedGravity(model, data, q).copy() for q in postures])
    # A torque is linear in gravity, so its maximum over all directions is the norm of its three
    # components.
    largest: Array = np.linalg.norm(along_axes, axis=0).max(axis=0)
    return largest
