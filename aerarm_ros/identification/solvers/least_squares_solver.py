"""Least-squares solver for the base parameters, thesis section 3.2."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.base_parameters import find_base_parameters
from aerarm_ros.identification.regression.model_fit import (
    ModelFit,
    RegressionBank,
    solve_regularised,
)
from aerarm_ros.identification.regression.regression import (
    ReducedRegression,
    SampleColumns,
    TriangularSystem,
)
from aerarm_ros.identification.solvers.estimate import PhysicalLimits
from aerarm_ros.identification.solvers.semidefinite_solver import solve_relaxed
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


_ROUNDS = 8
_BEND = 1.345  # standard deviations: 95 % of the efficiency of least squares for normal noise
_NORMAL = 1.4826  # ratio of standard deviation to median magnitude, for normal noise


def solve_huber(
    fit: ModelFit, bags: Sequence[SampleColumns], limits: PhysicalLimits
) -> tuple[Array, tuple[str, ...]]:
    """Minimize Huber's loss of the torque error over all physically possible parameters.

    Residuals beyond a threshold count linearly instead of quadratically. The weights are computed
    without constraints, which is fast, and then used in the semidefinite program.

    Parameters
    ----------
    fit : ModelFit
        Fit to the bags, as the initial value of the iteration.
    bags : sequence of SampleColumns
        Identification bags; their rows are reduced again in each round, because weights belong to
        samples.
    limits : PhysicalLimits
        Physical limits; contradictory user bounds are dropped, as for the recommended solver.

    Returns
    -------
    (p,) ndarray
        Parameters.
    tuple of str
        Notes on dropped bounds.

    Raises
    ------
    IdentificationError
        If the semidefinite program has no solution.
    """
    theta = fit.theta
    for _ in range(_ROUNDS):
        system = _reweighted(fit, bags, theta)
        theta = solve_regularised(system, fit.prior)
    return solve_relaxed(system, fit.prior, limits)


def _reweighted(fit: ModelFit, bags: Sequence[SampleColumns], theta: Array) -> TriangularSystem:
    """Return the problem with weights of the rows that depend on the residuals at `theta`."""
    residuals = [
        bag.weights * np.abs(bag.samples.tau - bag.predict(fit.model, theta).filtered)
        for bag in bags
    ]
    scale = np.array([_scale(fit, bags, residuals, joint) for joint in range(fit.model.n)])
    roots = [np.sqrt(np.minimum(1.0, _BEND * scale / np.maximum(r, 1e-300))) for r in residuals]
    terms = [term for _, term in fit.model.joint_columns]
    bank = RegressionBank(bags, terms, fit.inertial, roots)
    correlation = np.sqrt(np.median(fit.noise.correlation))
    return bank.regression(fit.model).system(1.0 / (scale * correlation))


def _scale(
    fit: ModelFit, bags: Sequence[SampleColumns], residuals: Sequence[Array], joint: int
) -> float:
    """Return a joint's noise [Nm], from the median of its residuals, which ignores outliers."""
    usable = [
        r[bag.samples.usable[:, joint], joint] for bag, r in zip(bags, residuals, strict=True)
    ]
    values = np.concatenate(usable)
    noise = float(fit.noise.std[joint])
    return max(_NORMAL * float(np.median(values)), 1e-3 * noise) if len(values) else noise
