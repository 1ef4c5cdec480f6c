"""SLSQP solves the thesis's problem, and comes close to the semidefinite program."""

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.solvers.thesis_solvers import ThesisProblem, solve_slsqp


def test_the_solution_satisfies_the_constraints_and_fits_the_data(
    problem: ThesisProblem, result: IdentificationResult
) -> None:
    theta = solve_slsqp(problem)
    assert problem.inequalities(theta[:40].reshape(4, 10)).min() > -1e-6
    lower, upper = problem.bounds()
    assert np.all((theta >= lower) & (theta <= upper))
    least = result.fit.regression.error(result.solutions['ols'].estimate.theta)
    assert least <= result.fit.regression.error(theta) < 1.2 * least


def test_same_seed_same_bits(problem: ThesisProblem) -> None:
    assert np.array_equal(solve_slsqp(problem, 1), solve_slsqp(problem, 1))
