"""Least squares with a prior, no constraints: the starting point of everything weighted."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.prior import Prior
from aerarm_ros.identification.regression.reduced_regression import TriangularSystem

Array = npt.NDArray[np.float64]


def solve_regularised(system: TriangularSystem, prior: Prior) -> Array:
    """Minimise torque error plus distance from the prior.

    Parameters
    ----------
    system : TriangularSystem
        Weighted to unit variance.
    prior : Prior

    Returns
    -------
    (p,) ndarray
    """
    rows = np.vstack([system.R * prior.std, np.eye(len(prior.mean))])
    right = np.concatenate([system.z - system.R @ prior.mean, np.zeros(len(prior.mean))])
    deviation, *_ = np.linalg.lstsq(rows, right, rcond=None)
    return np.asarray(prior.mean + prior.std * deviation)


def posterior_covariance(system: TriangularSystem, prior: Prior) -> Array:
    """Return the (p, p) covariance of the parameters given data and prior.

    Parameters
    ----------
    system : TriangularSystem
        Weighted to unit variance an independent sample.
    prior : Prior
    """
    rows = np.vstack([system.R * prior.std, np.eye(len(prior.mean))])
    inverse = np.linalg.inv(np.linalg.qr(rows, mode='r'))
    return np.asarray(np.outer(prior.std, prior.std) * (inverse @ inverse.T))
