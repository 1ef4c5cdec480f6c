"""The semidefinite program with outliers weighted down (Huber), iteratively re-weighted."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.identification.regression.model_fit import (
    ModelFit,
    RegressionBank,
    solve_regularised,
)
from aerarm_ros.identification.regression.regression import SampleColumns, TriangularSystem
from aerarm_ros.identification.solvers.estimate import PhysicalLimits
from aerarm_ros.identification.solvers.semidefinite_solver import solve_relaxed
from aerarm_ros.motion.signals import Array

_ROUNDS = 8
_BEND = 1.345  # standard deviations: 95 % as efficient as least squares on normal noise
_NORMAL = 1.4826  # standard deviation of normal noise over its median magnitude


def solve_huber(
    fit: ModelFit, bags: Sequence[SampleColumns], limits: PhysicalLimits
) -> tuple[Array, tuple[str, ...]]:
    """Minimise Huber's loss of the torque error over all possible bodies.

    Samples further off than the bend count linearly instead of squared. The weights are found
    without constraints, which is quick, and then used in the semidefinite program.

    Parameters
    ----------
    fit : ModelFit
        Of the bags: where the iteration starts.
    bags : sequence of SampleColumns
        To identify from: weights belong to samples, so the rows are reduced again each round.
    limits : PhysicalLimits
        Bounds of the user are given up where they contradict, as for the recommended solver.

    Returns
    -------
    (p,) ndarray
    tuple of str
        Bounds that had to be given up.

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
    """Return the problem with each row weighted by how far off it is at `theta`."""
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
    """Return a joint's noise [Nm] from the median, which outliers don't move."""
    usable = [
        r[bag.samples.usable[:, joint], joint] for bag, r in zip(bags, residuals, strict=True)
    ]
    values = np.concatenate(usable)
    noise = float(fit.noise.std[joint])
    return max(_NORMAL * float(np.median(values)), 1e-3 * noise) if len(values) else noise
