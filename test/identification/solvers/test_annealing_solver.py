"""Annealing stays within the thesis's constraints and approaches the best fit."""

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.solvers.thesis_solvers import ThesisProblem, solve_annealing


def test_the_solution_satisfies_the_constraints_and_fits_the_data(
    problem: ThesisProblem, result: IdentificationResult
) -> None:
    theta = solve_annealing(problem, sweeps=200)
    assert problem.inequalities(theta[:40].reshape(4, 10)).min() >= -1e-6
    lower, upper = problem.bounds()
    assert np.all((theta >= lower) & (theta <= upper))
    regression = result.fit.regression
    least = regression.error(result.solutions['ols'].estimate.theta)
    assert least <= regression.error(theta) < 3.0 * least


def test_same_seed_same_bits(problem: ThesisProblem) -> None:
    first, second = (solve_annealing(problem, 1, sweeps=5) for _ in range(2))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, solve_annealing(problem, 2, sweeps=5))
