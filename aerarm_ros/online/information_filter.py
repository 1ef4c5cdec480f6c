"""Recursive Bayesian regression with forgetting, which leads back to the prior."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.model.inertia import from_pseudo_inertia, pseudo_inertia
from aerarm_ros.motion.signals import Array


class Belief(NamedTuple):
    """Mean and information matrix of the estimate of m parameters.

    Attributes
    ----------
    mean : (m,) ndarray
    information : (m, m) ndarray
        Inverse of the covariance.
    covariance : (m, m) ndarray
    """

    mean: Array
    information: Array
    covariance: Array


class InformationFilter:
    """Recursive estimate of parameters, in units of the prior's standard deviations.

    The prior mean is zero. Forgetting replaces information by the prior's, `L <- D L D + (1 -
    D^2)`, for every parameter at its own rate. Parameters that the motion does not excite return
    to the prior's mean and spread, instead of growing without bound (Kulhavy, Kraus: On duality of
    regularized exponential and linear forgetting, 1996). The information is the sum of a prior and
    of squares, so it is positive definite in every step.

    Parameters
    ----------
    size : int
        m

    Attributes
    ----------
    belief : Belief
        Never changed in place.
    """

    def __init__(self, size: int) -> None:
        self._ones = np.ones(size)
        self.belief = Belief(np.zeros(size), np.eye(size), np.eye(size))

    def update(self, rows: Array, values: Array, variances: Array, kept: Array) -> None:
        """Discard a part of the old information, and add measurements.

        Parameters
        ----------
        rows : (k, m) ndarray
        values, variances : (k,) ndarray
            Measured values of `rows @ parameters`, and the variances of their noise.
        kept : (m,) ndarray
            D^2, the kept fraction of the information, 0 to 1.
        """
        mean, information, _ = self.belief
        root = np.sqrt(kept)
        prior = root[:, np.newaxis] * information * root
        weighted = (rows / variances[:, np.newaxis]).T
        known = prior @ mean + weighted @ values
        prior.ravel()[:: len(mean) + 1] += 1.0 - kept
        prior += weighted @ rows
        information = 0.5 * (prior + prior.T)
        covariance = np.linalg.inv(information)
        covariance = 0.5 * (covariance + covariance.T)
        self.belief = Belief(covariance @ known, information, covariance)

    def forget(self, which: slice) -> None:
        """Reset some parameters to the prior; all other parameters keep their information."""
        mean, _, covariance = self.belief
        mean, covariance = mean.copy(), covariance.copy()
        mean[which] = 0.0
        covariance[which, :] = covariance[:, which] = 0.0
        diagonal = np.arange(len(mean))[which]
        covariance[diagonal, diagonal] = 1.0
        self.belief = Belief(mean, np.asarray(np.linalg.inv(covariance)), covariance)


SPECK = 1e-6
"""Mass [kg] that means "no payload"; positive, because the estimator needs a body with mass."""
_ITERATIONS = 6
_DENSITY = 1000.0  # [kg/m^3] of the prior's ball: objects are about as dense as water
_ENTROPY = 0.5  # weight of the prior against a squared standard deviation
_FARTHEST = 4.0  # largest distance of a body's centre from the last joint, over the size
_BASIS = pseudo_inertia(np.eye(10)).reshape(10, 16)


def ball(mass: float, centre: npt.ArrayLike, radius: float) -> Array:
    """Return the inertial parameters (10,) of a ball with mass [kg], centre and radius [m]."""
    point = np.append(np.asarray(centre, dtype=float), 1.0)
    spread = np.diag([*[0.2 * radius**2] * 3, 0.0])
    return from_pseudo_inertia(mass * (np.outer(point, point) + spread))


def nearest_body(mean: Array, information: Array, size: float) -> Array:
    """Return the physically consistent inertial parameters (10,) nearest to an estimate.

    The parameters minimize the squared deviation from `mean` weighted by `information`, plus an
    entropic divergence (`solve_entropic`). The divergence is that from a ball of water with the
    estimate's mass and centre. The divergence keeps the 4x4 pseudo-inertia P in the cone of
    physical bodies, because its part `-log det P` grows without bound at the border. Newton's
    method starts at the ball and never leaves the cone, so P is positive definite after any number
    of steps.

    Parameters
    ----------
    mean : (10,) ndarray
        Estimate, possibly not physical, in the order of thesis (3.3).
    information : (10, 10) ndarray
        Inverse of its covariance.
    size : float
        Size of the payload [m].
    """
    mass = float(mean[0])
    if not mass > SPECK:
        return ball(SPECK, np.zeros(3), size)
    centre = np.clip(mean[1:4] / mass, -_FARTHEST * size, _FARTHEST * size)
    # In units of mass and size, in which all entries have one order of magnitude.
    scale = mass * np.array([1.0, *[size] * 3, *[size**2] * 6])
    radius = np.cbrt(0.75 * mass / (np.pi * _DENSITY))
    start = ball(1.0, centre / size, radius / size)
    own = scale[:, np.newaxis] * information * scale
    return scale * _minimised(start, mean / scale, own)


def _minimised(start: Array, mean: Array, information: Array) -> Array:
    attraction = _ENTROPY * (_BASIS @ np.linalg.inv(pseudo_inertia(start)).ravel())
    body = start
    inverse = np.linalg.inv(pseudo_inertia(body))
    for _ in range(_ITERATIONS):
        slope = information @ (body - mean) + attraction - _ENTROPY * (_BASIS @ inverse.ravel())
        turned = (inverse @ _BASIS.reshape(10, 4, 4) @ inverse).reshape(10, 16)
        step = np.linalg.solve(information + _ENTROPY * _BASIS @ turned.T, -slope)
        decrement = -float(slope @ step)
        if decrement < 1e-4:
            break
        # Self-concordance: so short a step cannot leave the cone.
        length = np.sqrt(decrement / _ENTROPY)
        candidate = body + step / (1.0 + length)
        if length > 0.5 and _is_inside(body + step):
            candidate = body + step
        body = candidate
        inverse = np.linalg.inv(pseudo_inertia(body))
    return body


def _is_inside(body: Array) -> bool:
    return bool(np.linalg.eigvalsh(pseudo_inertia(body))[0] > 1e-6)
