"""Inverse and direct dynamics of an arm, thesis (2.5)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.inertia import checked_body
from aerarm_ros.motion.signals import Array


class LastLink:
    """The last body of a model, which may carry another one.

    Parameters
    ----------
    model : pin.Model
        It is changed in place.
    """

    def __init__(self, model: Any) -> None:
        self._model = model
        self._own = pin.Inertia(model.inertias[model.njoints - 1])

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the link, in place of one added before; see `Dynamics.carry`."""
        whole = self._own.toDynamicParameters() + checked_payload(payload)
        self._model.inertias[self._model.njoints - 1] = pin.Inertia.FromDynamicParameters(whole)


def checked_payload(payload: npt.ArrayLike) -> Array:
    """Return a payload's (10,) inertial parameters; raises ValueError if no body has them."""
    return checked_body('payload', payload, ': pass the ten inertial parameters of payload.yaml')


class Dynamics:
    """Rigid dynamics `B(q) ddq + C(q, dq) dq + g(q) = xi` of n joints, thesis (2.5).

    The rotors turn 1/k_g times faster than the joints; their inertia J_m / k_g^2 is added to
    the diagonal of B. Gyroscopic effects of the rotors are neglected. Friction isn't part of
    the model (see `friction`).

    Made to be called in a 1 kHz loop: arguments are (n,) float arrays and are not checked
    beyond their length. An instance holds working memory: use one a thread.

    Parameters
    ----------
    robot : Robot
    rotor_inertia : float or (n,) array_like
        Rotor inertia at the joints [kg m^2], e.g. `DriveTrain.reflected_inertia`.

    Raises
    ------
    ValueError
        If a rotor inertia is negative or not finite, or their number isn't n.
    """

    def __init__(self, robot: Robot, rotor_inertia: npt.ArrayLike = 0.0) -> None:
        self.robot = robot
        self._model = robot.model.copy()
        # Pinocchio adds the armature in rnea, crba and aba.
        self._rotor_inertia = checked_rotor_inertia(rotor_inertia, robot.n)
        self._rotor_inertia.flags.writeable = False
        self._model.armature = self._rotor_inertia
        self._data = self._model.createData()
        self._last_link = LastLink(self._model)

    @property
    def rotor_inertia(self) -> Array:
        """(n,) rotor inertia at the joints [kg m^2], read-only."""
        return self._rotor_inertia

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the last link, in place of one added before.

        Parameters
        ----------
        payload : (10,) array_like
            Inertial parameters (3.3) in the frame of the last link's joint; zeros for nothing.

        Raises
        ------
        ValueError
            If no body has them.
        """
        self._last_link.carry(payload)

    def inertia_matrix(self, q: Array) -> Array:
        """Return B(q), (n, n) [kg m^2], symmetric, rotors included."""
        return np.asarray(pin.crba(self._model, self._data, q))

    def mobility_matrix(self, q: Array) -> Array:
        """Return B(q)^-1, (n, n) [1/(kg m^2)], symmetric, without a factorisation of B."""
        return np.asarray(pin.computeMinverse(self._model, self._data, q))

    def coriolis_matrix(self, q: Array, dq: Array) -> Array:
        """Return C(q, dq), (n, n) [Nms/rad], for which dB/dt - 2 C is skew-symmetric."""
        return np.asarray(pin.computeCoriolisMatrix(self._model, self._data, q, dq))

    def gravity(self, q: Array) -> Array:
        """Return g(q), (n,) [Nm]."""
        return np.asarray(pin.computeGeneralizedGravity(self._model, self._data, q))

    def bias(self, q: Array, dq: Array) -> Array:
        """Return n(q, dq) = C(q, dq) dq + g(q), (n,) [Nm]."""
        return np.asarray(pin.nonLinearEffects(self._model, self._data, q, dq))

    def inverse(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Return the torques [Nm] of a motion: inverse dynamics by recursive Newton-Euler.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            [rad], [rad/s], [rad/s^2]

        Returns
        -------
        (n,) ndarray
            xi of (2.5) [Nm], rotors included.
        """
        return np.asarray(pin.rnea(self._model, self._data, q, dq, ddq))

    def inverse_with_slopes(
        self, q: Array, dq: Array, ddq: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return `inverse` and how it changes with the motion.

        Returns
        -------
        xi : (n,) ndarray
            [Nm]
        by_q, by_dq, by_ddq : (n, n) ndarray
            Derivatives of row i's torque by column j's position [Nm/rad], velocity [Nms/rad] and
            acceleration [kg m^2]; the last is B(q). They are working memory: the next call
            overwrites them.
        """
        by_q, by_dq, by_ddq = pin.computeRNEADerivatives(self._model, self._data, q, dq, ddq)
        return self._data.tau, by_q, by_dq, by_ddq

    def forward(self, q: Array, dq: Array, tau: Array) -> Array:
        """Return the accelerations [rad/s^2] under torques: direct dynamics.

        Parameters
        ----------
        q, dq, tau : (n,) ndarray
            [rad], [rad/s], [Nm]; `tau` is xi of (2.5), what friction leaves of the drive's.

        Returns
        -------
        (n,) ndarray
            [rad/s^2]
        """
        return np.asarray(pin.aba(self._model, self._data, q, dq, tau))

    def kinetic_energy(self, q: Array, dq: Array) -> float:
        """Return `dq^T B(q) dq / 2` [J], rotors included."""
        return float(0.5 * dq @ self.inertia_matrix(q) @ dq)

    def potential_energy(self, q: Array) -> float:
        """Return the energy [J] in the field of gravity, up to a constant."""
        return float(pin.computePotentialEnergy(self._model, self._data, q))


def checked_rotor_inertia(rotor_inertia: npt.ArrayLike, n: int) -> Array:
    """Return the rotors' inertia at n joints, (n,) [kg m^2], one number being that of all.

    Raises
    ------
    ValueError
        If one is negative or not finite, or their number isn't n.
    """
    inertia = np.asarray(rotor_inertia, dtype=float)
    if inertia.shape not in ((), (n,)):
        raise ValueError(f'{inertia.size} rotor inertias were given for {n} joints')
    if not np.all(np.isfinite(inertia) & (inertia >= 0.0)):
        raise ValueError(f'rotor inertias {inertia} must be finite and not negative [kg m^2]')
    return np.broadcast_to(inertia, (n,)).copy()


GRAVITY = 9.81
"""[m/s^2]"""
_POSTURES = 500


def largest_gravity_load(robot: Robot) -> Array:
    """Return the largest gravity torques over all postures and directions of gravity.

    The directions are taken exactly, the postures as a sample between the joints' limits.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    (n,) ndarray
        [Nm], none negative.
    """
    model = robot.model.copy()
    data = model.createData()
    random = np.random.default_rng(0)
    postures = random.uniform(*robot.posture_range, (_POSTURES, robot.n))
    along_axes = []
    for direction in np.eye(3):
        model.gravity.linear = GRAVITY * direction
        along_axes.append([pin.computeGeneralizedGravity(model, data, q).copy() for q in postures])
    # A torque is linear in gravity: its largest value is the norm of the three.
    largest: Array = np.linalg.norm(along_axes, axis=0).max(axis=0)
    return largest
