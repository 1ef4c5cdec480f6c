"""The prior is about CAD, and weak."""

import numpy as np

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.regression.base_parameters import prior_from_cad


def test_mean_is_cad_and_spread_is_positive(result: IdentificationResult) -> None:
    fit = result.fit
    prior = prior_from_cad(result.cad, fit.model, fit.regression)
    assert np.array_equal(prior.mean, result.cad.vector(fit.model))
    assert np.all(prior.std > 0.0)


def test_data_overrule_it_where_they_say_something(result: IdentificationResult) -> None:
    """All base parameters together: the prior moves the fit by less than the noise does."""
    fit = result.fit
    ols = result.solutions['wls'].estimate.theta
    system = fit.regression.system(fit.noise.weights)
    moved = np.linalg.norm(system.R @ (fit.theta - ols))
    assert moved < 0.2 * np.linalg.norm(system.R @ ols - system.z)
