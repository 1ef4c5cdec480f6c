"""Prior and data are weighed as normal distributions."""

import numpy as np

from aerarm_ros.identification.regression.base_parameters import Prior
from aerarm_ros.identification.regression.model_fit import posterior_covariance, solve_regularised
from aerarm_ros.identification.regression.regression import TriangularSystem

PRIOR = Prior(np.array([1.0, -2.0, 0.5]), np.array([0.1, 2.0, 30.0]))


def test_solution_and_covariance_are_those_of_bayes_rule() -> None:
    random = np.random.default_rng(0)
    system = TriangularSystem(np.triu(random.standard_normal((3, 3))), random.standard_normal(3))
    information = system.R.T @ system.R + np.diag(1.0 / PRIOR.std**2)
    assert np.allclose(posterior_covariance(system, PRIOR), np.linalg.inv(information))
    right = system.R.T @ system.z + PRIOR.mean / PRIOR.std**2
    assert np.allclose(solve_regularised(system, PRIOR), np.linalg.solve(information, right))


def test_without_data_the_prior_is_left() -> None:
    nothing = TriangularSystem(np.zeros((3, 3)), np.zeros(3))
    assert np.allclose(solve_regularised(nothing, PRIOR), PRIOR.mean)
    assert np.allclose(posterior_covariance(nothing, PRIOR), np.diag(PRIOR.std**2))
