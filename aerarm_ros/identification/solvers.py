"""Every solver on one reduced regression."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.estimate import Estimate
from aerarm_ros.identification.least_squares_solver import solve_least_squares
from aerarm_ros.identification.model_fit import ModelFit
from aerarm_ros.identification.regularised_solver import posterior_covariance
from aerarm_ros.identification.semidefinite_solver import PhysicalLimits, solve_semidefinite

Array = npt.NDArray[np.float64]

RECOMMENDED = 'sdp'
"""The solver whose estimate is physically consistent."""


def solve_all(fit: ModelFit, cad: ArmParameters) -> dict[str, Estimate]:
    """Return the estimate of each solver.

    Parameters
    ----------
    fit : ModelFit
        Regression, prior and noise.
    cad : ArmParameters
        Gives the physical limits.

    Raises
    ------
    IdentificationError
        If the semidefinite program has no solution.
    """
    regression, prior, weights = fit.regression, fit.prior, fit.noise.weights
    solvers: dict[str, Callable[[], Array]] = {
        'cad': lambda: prior.mean,
        'ols': lambda: solve_least_squares(regression, prior.mean),
        'wls': lambda: solve_least_squares(regression, prior.mean, weights),
        'sdp': lambda: solve_semidefinite(
            regression.system(weights), prior, physical_limits(fit, cad)
        ),
    }
    estimates = {}
    for name, solve in solvers.items():
        begin = time.perf_counter()
        theta = solve()
        seconds = time.perf_counter() - begin
        estimates[name] = Estimate(name, fit.model, theta, seconds=seconds)
    estimates[RECOMMENDED] = _with_uncertainty(estimates[RECOMMENDED], fit)
    return estimates


def physical_limits(fit: ModelFit, cad: ArmParameters) -> PhysicalLimits:
    """Return what the parameters of a real arm with these joints obey."""
    scale = cad.inertial_scale()
    return PhysicalLimits(
        mass=cad.inertial[:, 0],
        size=scale[:, 1] / scale[:, 0],
        nonnegative=np.array([term.nonnegative for _, term in fit.model.joint_columns], dtype=bool),
    )


def _with_uncertainty(estimate: Estimate, fit: ModelFit) -> Estimate:
    """Add standard deviations: prior and data as normal distributions, constraints left out."""
    system = fit.regression.system(fit.noise.information_weights)
    variance = np.diag(posterior_covariance(system, fit.prior))
    determined = np.clip(1.0 - variance / fit.prior.std**2, 0.0, 1.0)
    return replace(estimate, std=np.sqrt(variance), determined=determined)
