"""SLSQP solves the thesis's problem, and comes close to the semidefinite program."""

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.solvers.thesis_solvers import ThesisProblem


def test_the_solution_satisfies_the_constraints_and_fits_the_data(
    problem: ThesisProblem, result: IdentificationResult, slsqp: np.ndarray
) -> None:
    theta = slsqp
    assert problem.inequalities(theta[:40].reshape(4, 10)).min() > -1e-6
    lower, upper = problem.bounds()
    assert np.all((theta >= lower) & (theta <= upper))
    least = result.fit.regression.error(result.solutions['ols'].estimate.theta)
    assert least <= result.fit.regression.error(theta) < 1.2 * least
