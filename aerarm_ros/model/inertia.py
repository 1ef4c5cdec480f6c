"""Inertial parameters of a link, and their physical consistency.

The order of a ten-vector `pi` is that of thesis (3.3) and of Pinocchio's `toDynamicParameters`:
mass [kg], first moment `m c` [kg m], and the inertia tensor about the origin of the link frame [kg
m^2]. `Ixy` is the tensor's off-diagonal entry, as in URDF files (so `Ixy = -m cx cy` for a point
mass).

Every function accepts arrays of ten-vectors, with the parameters on the last axis.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from aerarm_ros.motion.signals import Array

Vector = npt.NDArray[np.floating[Any]]


def cross(a: Vector, b: Vector) -> Array:
    """Return the cross product a x b of two vectors (3,), faster than `np.cross`."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


PARAMETER_NAMES = ('m', 'mcx', 'mcy', 'mcz', 'Ixx', 'Ixy', 'Iyy', 'Ixz', 'Iyz', 'Izz')

# rounding error of decimal parameters, relative to the largest entry of a pseudo-inertia
_ROUNDING = 1e-9

# Positions of Ixx, Ixy, Iyy, Ixz, Iyz, Izz in the tensor.
_ROWS = np.array([0, 0, 1, 0, 1, 2])
_COLUMNS = np.array([0, 1, 1, 2, 2, 2])


def inertia_about_origin(pi: npt.ArrayLike) -> Array:
    """Return the inertia tensors about the link frame's origin.

    Parameters
    ----------
    pi : (..., 10) array_like
        Inertial parameters.

    Returns
    -------
    (..., 3, 3) ndarray
        Inertia tensors [kg m^2].
    """
    pi = _parameters(pi)
    tensor = np.empty((*pi.shape[:-1], 3, 3))
    tensor[..., _ROWS, _COLUMNS] = pi[..., 4:]
    tensor[..., _COLUMNS, _ROWS] = pi[..., 4:]
    return tensor


def barycentric_inertia(pi: npt.ArrayLike) -> Array:
    """Return the inertia tensors about the centres of mass, in the link frames' axes.

    Thesis (3.2), with the factor 1/m that the printed (3.4) lacks: `Ibar - S(mc)^T S(mc) / m`.

    Parameters
    ----------
    pi : (..., 10) array_like
        Inertial parameters with non-zero masses.

    Returns
    -------
    (..., 3, 3) ndarray
        Inertia tensors [kg m^2].

    Raises
    ------
    ValueError
        If a mass is zero, because the centre of mass is then undefined.
    """
    pi = _parameters(pi)
    mass = pi[..., 0, None, None]
    if np.any(mass == 0.0):
        raise ValueError('a body of zero mass has no centre of mass: check the masses of the links')
    moment = pi[..., 1:4]
    return inertia_about_origin(pi) - _steiner(moment) / mass


def parameters_of_body(mass: float, centre: npt.ArrayLike, inertia: npt.ArrayLike) -> Array:
    """Return the inertial parameters (10,) of a body with a given mass, centre of mass and inertia.

    Parameters
    ----------
    mass : float
        Mass of the body [kg].
    centre : (3,) array_like
        Centre of mass from the frame's origin [m].
    inertia : (3, 3) array_like
        Inertia tensor about the centre of mass, in the frame's axes [kg m^2].
    """
    lever = np.asarray(centre, dtype=float)
    tensor = np.asarray(inertia, dtype=float) + mass * _steiner(lever)
    return np.concatenate([[mass], mass * lever, tensor[_ROWS, _COLUMNS]])


def joined(*bodies: tuple[float, npt.ArrayLike, npt.ArrayLike]) -> tuple[float, Array, Array]:
    """Return mass, centre of mass and inertia of several bodies that are rigidly joined.

    Parameters
    ----------
    bodies : tuple of float, (3,) array_like, (3, 3) array_like
        Mass [kg], centre of mass [m] and inertia about it [kg m^2] of each body, in a common frame.

    Returns
    -------
    mass : float
        Total mass [kg].
    centre : (3,) ndarray
        Common centre of mass [m].
    inertia : (3, 3) ndarray
        Inertia tensor about the common centre, in the frame's axes [kg m^2].
    """
    pi = sum((parameters_of_body(*body) for body in bodies), np.zeros(10))
    return float(pi[0]), pi[1:4] / pi[0], barycentric_inertia(pi)


def pseudo_inertia(pi: npt.ArrayLike) -> Array:
    """Return the pseudo-inertia matrices of Wensing, Kim and Slotine (RA-L 2018).

    `P = [[tr(Ibar)/2 1 - Ibar, m c], [(m c)^T, m]]`, linear in the parameters. P is the second
    moment of the mass distribution in homogeneous coordinates. P is positive semidefinite if and
    only if some mass distribution has these parameters.

    Parameters
    ----------
    pi : (..., 10) array_like
        Inertial parameters.

    Returns
    -------
    (..., 4, 4) ndarray
        Matrices with units [kg m^2] in the upper left block, [kg m] in the last row and column,
        and [kg] in the lower right corner.
    """
    pi = _parameters(pi)
    tensor = inertia_about_origin(pi)
    half_trace = 0.5 * np.trace(tensor, axis1=-2, axis2=-1)
    matrix = np.empty((*pi.shape[:-1], 4, 4))
    matrix[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - tensor
    matrix[..., :3, 3] = matrix[..., 3, :3] = pi[..., 1:4]
    matrix[..., 3, 3] = pi[..., 0]
    return matrix


def from_pseudo_inertia(matrix: npt.ArrayLike) -> Array:
    """Return the inertial parameters of bodies, given their pseudo-inertia matrices.

    Parameters
    ----------
    matrix : (..., 4, 4) array_like
        Symmetric pseudo-inertia matrices.

    Returns
    -------
    (..., 10) ndarray
        Inertial parameters.
    """
    matrix = np.asarray(matrix, dtype=float)
    if matrix.shape[-2:] != (4, 4):
        raise ValueError(f'a pseudo-inertia matrix must be 4x4, but its shape is {matrix.shape}')
    second_moment = matrix[..., :3, :3]
    # tr(P3) = 3/2 tr(Ibar) - tr(Ibar) = tr(Ibar)/2
    half_trace = np.trace(second_moment, axis1=-2, axis2=-1)
    tensor = half_trace[..., None, None] * np.eye(3) - second_moment
    pi = np.empty((*matrix.shape[:-2], 10))
    pi[..., 0] = matrix[..., 3, 3]
    pi[..., 1:4] = matrix[..., :3, 3]
    pi[..., 4:] = tensor[..., _ROWS, _COLUMNS]
    return pi


def point_mass(mass: float, centre: npt.ArrayLike) -> Array:
    """Return the inertial parameters (10,) of a mass [kg] at a point (3,) [m]."""
    point = np.append(np.asarray(centre, dtype=float), 1.0)
    return from_pseudo_inertia(mass * np.outer(point, point))


def minimum_eigenvalue(pi: npt.ArrayLike) -> float:
    """Return the smallest eigenvalue of all pseudo-inertia matrices that `pi` describes.

    Parameters
    ----------
    pi : (..., 10) array_like
        Inertial parameters of one or several bodies.
    """
    return float(np.min(np.linalg.eigvalsh(pseudo_inertia(pi))))


def is_physically_consistent(pi: npt.ArrayLike, tolerance: float = 0.0) -> bool:
    """Return whether a body of nonnegative density can have these inertial parameters.

    The check is stronger than thesis (3.9)-(3.15), which requires only a positive definite
    barycentric inertia. The principal moments of a real body also satisfy the triangle inequality.

    Parameters
    ----------
    pi : (..., 10) array_like
        Inertial parameters of one or several bodies.
    tolerance : float
        Largest magnitude of a negative eigenvalue that counts as rounding error.
    """
    return minimum_eigenvalue(pi) >= -tolerance


def checked_body(name: str, pi: npt.ArrayLike, advice: str = '') -> Array:
    """Check a body's inertial parameters and return them, (10,); all zeros mean no body.

    Raises
    ------
    ValueError
        If the parameters are impossible; the message begins with `name` and ends with `advice`.
    """
    values = np.array(pi, dtype=float)
    numbers = values.shape == (10,) and bool(np.isfinite(values).all())
    if not numbers or not is_physically_consistent(values, _ROUNDING):
        raise ValueError(
            f'{name} {values.tolist()} is invalid, because no body has these inertial '
            f'parameters' + (f': {advice}' if advice else '')
        )
    return values


def _parameters(pi: npt.ArrayLike) -> Array:
    pi = np.asarray(pi, dtype=float)
    if pi.ndim == 0 or pi.shape[-1] != 10:
        raise ValueError(f'each body needs ten inertial parameters, but the shape is {pi.shape}')
    return pi


def _steiner(moment: Array) -> Array:
    """Return `S(a)^T S(a) = a.a 1 - a a^T` for each vector of `moment`, (..., 3)."""
    square = np.sum(moment * moment, axis=-1)[..., None, None]
    return np.asarray(square * np.eye(3) - moment[..., :, None] * moment[..., None, :])
