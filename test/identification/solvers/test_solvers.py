"""Every solver solves the same problem, with its own constraints."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import (
    ROTOR,
    THESIS_TERMS,
    ArmParameters,
    JointModel,
    JointTerm,
    TermKind,
)
from aerarm_ros.identification.regression import ReducedRegression
from aerarm_ros.identification.solvers.estimate import SOLVERS, Estimate, solver
from aerarm_ros.identification.solvers.solvers import RECOMMENDED, solve_all
from aerarm_ros.identification.solvers.thesis_solver import ThesisProblem, solve_annealing
from aerarm_ros.model.inertia import barycentric_inertia


def test_solvers_run_on_request_in_the_expected_order(
    result: IdentificationResult, slsqp: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    regression, told = result.fit.regression, []
    with monkeypatch.context() as patch:
        patch.setitem(SOLVERS, 'halved', None)  # removes the new solver afterwards
        solver('halved', 'half of the nominal parameters', 9, True)(lambda f, _: 0.5 * f.prior.mean)
        estimates = solve_all(result.fit, result.cad, ['slsqp', 'halved'], told.append)
    assert list(estimates) == ['cad', 'cad_friction', 'ols', 'slsqp', 'sdp', 'halved']
    assert told == ['slsqp']  # the only slow one
    assert np.array_equal(estimates['slsqp'].theta, slsqp)  # the same bits in every run
    assert np.array_equal(estimates['cad'].theta, result.fit.prior.mean)
    assert np.array_equal(estimates['halved'].theta, 0.5 * result.fit.prior.mean)
    errors = {name: regression.error(estimate.theta) for name, estimate in estimates.items()}
    assert min(errors, key=errors.get) == 'ols'
    assert errors['cad'] > 3.0 * errors['sdp']
    assert errors['sdp'] < 1.5 * errors['ols']
    with pytest.raises(IdentificationError, match='halved: choose from cad, cad_friction, ols'):
        solve_all(result.fit, result.cad, ['halved'])


def test_one_that_cannot_solve_is_left_out_and_named(result: IdentificationResult) -> None:
    mean = result.fit.prior.mean.copy()
    mean[21:30] = 0.0  # link 3 is a point: no drawing for an entropic prior
    fit = replace(result.fit, prior=replace(result.fit.prior, mean=mean))
    estimates = solve_all(fit, result.cad, ['entropic'])
    assert 'entropic' not in estimates
    (note,) = estimates[RECOMMENDED].notes
    assert 'solver entropic was skipped' in note
    assert 'link 3' in note


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


@pytest.mark.parametrize(('column', 'physical'), [('fv_joint2', False), ('fo_joint2', True)])
def test_negative_coefficients(robot: Robot, column: str, physical: bool) -> None:
    terms = (*THESIS_TERMS, ROTOR, JointTerm(TermKind.OFFSET))
    model = JointModel.uniform(robot.joint_names, robot.link_names, terms)
    theta = ArmParameters.stated(robot, None).vector(model)
    theta[model.columns.index(column)] = -0.1
    estimate = Estimate('test', model, theta)
    assert estimate.physically_consistent == physical
    assert estimate.joint_values(column[:2])[1] == -0.1


def inertial(problem: ThesisProblem, theta: np.ndarray) -> np.ndarray:
    return theta[: 10 * problem.n].reshape(-1, 10)


def test_cad_obeys_every_constraint_and_each_notices_its_violation(problem: ThesisProblem) -> None:
    cad = inertial(problem, problem.start)
    assert problem.inequalities(cad).min() > 0.0
    lower, upper = problem.bounds()
    assert np.all((lower <= problem.start) & (problem.start <= upper))
    flat, shifted = cad.copy(), cad.copy()
    flat[1, 4] -= 1.01 * barycentric_inertia(cad[1])[0, 0]
    shifted[2, 1] += 2.0 * cad[2, 0] * problem.limits.size[2]
    for wrong, links in ((flat, {1}), (shifted, {2})):
        values = problem.inequalities(wrong)[:-2].reshape(-1, 9)
        assert set(np.flatnonzero(values.min(axis=1) < 0.0)) == links
    assert problem.inequalities(2.1 * cad)[-1] < 0.0


def test_slopes_are_those_of_the_functions(problem: ThesisProblem) -> None:
    random = np.random.default_rng(3)
    theta = problem.random_start(random)
    direction = problem.scale * random.standard_normal(len(theta))
    step = 1e-5 * direction
    slope = (problem.cost(theta + step) - problem.cost(theta - step)) / 2e-5
    assert problem.gradient(theta) @ direction == pytest.approx(slope, rel=1e-5)
    ahead, behind = (
        problem.inequalities(inertial(problem, theta + sign * step)) for sign in (1.0, -1.0)
    )
    slopes = problem.inequality_slopes(inertial(problem, theta))
    expected = (ahead - behind) / 2e-5
    assert slopes @ direction[: 10 * problem.n] == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_same_seed_same_bits(problem: ThesisProblem) -> None:
    first, second = (solve_annealing(problem, 1, sweeps=5) for _ in range(2))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, solve_annealing(problem, 2, sweeps=5))


@pytest.mark.parametrize(('solver', 'most'), [('slsqp', 1.2), ('annealing', 3.0)])
def test_the_solution_satisfies_the_constraints_and_fits_the_data(
    problem: ThesisProblem, result: IdentificationResult, slsqp: np.ndarray, solver, most
) -> None:
    theta = slsqp if solver == 'slsqp' else solve_annealing(problem, sweeps=200)
    assert problem.inequalities(inertial(problem, theta)).min() >= -1e-6
    lower, upper = problem.bounds()
    assert np.all((theta >= lower) & (theta <= upper))
    regression = result.fit.regression
    least = regression.error(result.solutions['ols'].estimate.theta)
    assert least <= regression.error(theta) < most * least
