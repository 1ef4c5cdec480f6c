"""Every solver solves the same problem."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.regression.regression import ReducedRegression
from aerarm_ros.identification.solvers.solvers import RECOMMENDED, physical_limits, solve_all


@pytest.fixture(scope='module')
def estimates(result: IdentificationResult):
    return solve_all(result.fit, result.cad)


def test_solver_errors_have_the_expected_order(result: IdentificationResult, estimates) -> None:
    regression = result.fit.regression
    errors = {name: regression.error(estimate.theta) for name, estimate in estimates.items()}
    assert min(errors, key=errors.get) == 'ols'
    assert errors['cad'] > 3.0 * errors['sdp']
    assert errors['sdp'] < 1.5 * errors['ols']
    assert np.array_equal(estimates['cad'].theta, result.fit.prior.mean)


def test_only_the_recommended_one_has_uncertainty_and_is_physical(estimates) -> None:
    assert RECOMMENDED == 'sdp'
    assert estimates['sdp'].physically_consistent
    assert estimates['sdp'].std is not None
    assert estimates['ols'].std is None


def test_limits_are_those_of_cad(result: IdentificationResult) -> None:
    limits = physical_limits(result.fit, result.cad)
    assert np.array_equal(limits.mass, result.cad.inertial[:, 0])
    assert limits.nonnegative.all()
    assert np.all((limits.size >= 0.05) & (limits.size < 1.0))
    lower, upper = limits.centre_box
    centre = result.cad.inertial[:, 1:4] / result.cad.inertial[:, :1]
    assert np.all((lower < centre) & (centre < upper))


def test_slow_solvers_run_on_request_and_report_progress(
    result: IdentificationResult, slsqp: np.ndarray
) -> None:
    told: list[str] = []
    estimates = solve_all(result.fit, result.cad, ['slsqp'], told.append)
    assert list(estimates) == ['cad', 'cad_friction', 'ols', 'slsqp', 'sdp']
    assert told == ['slsqp']
    assert np.array_equal(estimates['slsqp'].theta, slsqp)  # the same bits in every run


def test_one_that_cannot_solve_is_left_out_and_named(result: IdentificationResult) -> None:
    mean = result.fit.prior.mean.copy()
    mean[21:30] = 0.0  # link 3 is a point: no drawing for an entropic prior
    fit = replace(result.fit, prior=replace(result.fit.prior, mean=mean))
    estimates = solve_all(fit, result.cad, ['entropic'])
    assert 'entropic' not in estimates
    (note,) = estimates[RECOMMENDED].notes
    assert 'solver entropic was skipped' in note
    assert 'link 3' in note


def test_an_unknown_solver_is_refused(result: IdentificationResult) -> None:
    with pytest.raises(IdentificationError, match='choose from cad, cad_friction'):
        solve_all(result.fit, result.cad, names=['magic'])


def test_a_parameter_at_its_bound_is_exactly_zero(result: IdentificationResult) -> None:
    """Friction that the data want to be a little below 0."""
    fit = result.fit
    index = fit.model.columns.index('fv_joint2')
    less = fit.theta[index] + 0.5 * np.sqrt(fit.covariance[index, index])
    factors = [factor.copy() for factor in fit.regression.factors]
    for factor in factors:
        factor[:, -1] -= less * factor[:, index]
    regression = ReducedRegression(fit.model.columns, factors, fit.regression.rows)
    estimate = solve_all(replace(fit, regression=regression), result.cad)[RECOMMENDED]
    assert estimate.theta[index] == 0.0
    assert estimate.std[index] > 0.0
