"""Least squares for the base parameters, thesis section 3.2, and the CAD models for comparison."""

import numpy as np
import numpy.typing as npt
from scipy.optimize import lsq_linear

from aerarm_ros.identification.joint_model import TermKind
from aerarm_ros.identification.model_fit import ModelFit, find_base_parameters
from aerarm_ros.identification.regression import ReducedRegression
from aerarm_ros.identification.solvers.estimate import PhysicalLimits, solver
from aerarm_ros.motion.signals import Array


def solve_least_squares(
    regression: ReducedRegression, reference: Array, weights: npt.ArrayLike = 1.0
) -> Array:
    """Minimize the torque error without constraints.

    Only base parameters have a unique solution. The returned parameter vector has the optimal
    base parameters; all dependent parameters are those of the reference. The solution has the
    smallest possible torque error, but may be physically impossible.

    Parameters
    ----------
    reference : (p,) ndarray
        Reference parameters, usually CAD.
    weights : float or (n,) array_like
        Factors of each joint's rows, one over its noise [1/Nm]; 1 is ordinary least squares.

    Returns
    -------
    (p,) ndarray
    """
    base = find_base_parameters(regression.system().R, regression.columns)
    system = regression.system(weights)
    reduced = system.R[:, base.independent]
    scale = np.linalg.norm(reduced, axis=0)
    values, *_ = np.linalg.lstsq(reduced / scale, system.z, rcond=None)
    return base.complete(values / scale, reference)


@solver('cad', 'input URDF', 0, is_fast=True)
def _cad(fit: ModelFit, limits: PhysicalLimits) -> Array:
    return fit.prior.mean


@solver('cad_friction', 'nominal links and rotors, with identified friction', 1, is_fast=True)
def _cad_friction(fit: ModelFit, limits: PhysicalLimits) -> Array:
    """Return the nominal parameters of links and rotors, with the best-fitting friction.

    Friction is fitted because a URDF often has none, which would make the comparison with CAD
    meaningless.
    """
    system = fit.regression.system(fit.noise.weights)
    rotors = np.array([term.kind is TermKind.ROTOR for _, term in fit.model.joint_columns])
    fitted = np.flatnonzero(np.append(np.zeros(10 * fit.model.n, dtype=bool), ~rotors))
    theta = np.where(np.isin(np.arange(len(fit.prior.mean)), fitted), 0.0, fit.prior.mean)
    if len(fitted):
        lower = np.where(limits.nonnegative[~rotors], 0.0, -np.inf)
        rest = system.z - system.R @ theta
        theta[fitted] = lsq_linear(system.R[:, fitted], rest, (lower, np.inf)).x
    return np.asarray(theta)


@solver('ols', 'ordinary least squares on the base parameters', 2, is_fast=True)
def _ols(fit: ModelFit, limits: PhysicalLimits) -> Array:
    return solve_least_squares(fit.regression, fit.prior.mean)


@solver(
    'wls', "least squares on the base parameters, weighted by each joint's noise", 3, is_fast=True
)
def _wls(fit: ModelFit, limits: PhysicalLimits) -> Array:
    return solve_least_squares(fit.regression, fit.prior.mean, fit.noise.weights)
