"""The thesis's constraints say what they should, and their slopes are right."""

import numpy as np
import pytest

from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.solvers.thesis_solvers import ThesisProblem
from aerarm_ros.model.inertia import barycentric_inertia


def inertial(problem: ThesisProblem, theta: np.ndarray) -> np.ndarray:
    return theta[: 10 * problem.n].reshape(-1, 10)


def test_cad_obeys_every_constraint(problem: ThesisProblem) -> None:
    assert problem.inequalities(inertial(problem, problem.start)).min() > 0.0
    lower, upper = problem.bounds()
    assert np.all((lower <= problem.start) & (problem.start <= upper))


def test_each_constraint_notices_its_violation(problem: ThesisProblem) -> None:
    cad = inertial(problem, problem.start)
    flat = cad.copy()
    flat[1, 4] -= 1.01 * barycentric_inertia(cad[1])[0, 0]
    shifted = cad.copy()
    shifted[2, 1] += 2.0 * cad[2, 0] * problem.limits.size[2]
    heavy = cad * 2.1
    for wrong, links in ((flat, {1}), (shifted, {2})):
        values = problem.inequalities(wrong)[:-2].reshape(-1, 9)
        assert set(np.flatnonzero(values.min(axis=1) < 0.0)) == links
    assert problem.inequalities(heavy)[-1] < 0.0


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


def test_the_cost_is_the_squared_torque_error(
    problem: ThesisProblem, result: IdentificationResult
) -> None:
    """At the least-squares solution the part that no parameters explain is all that is missing."""
    regression = result.fit.regression
    theta, cad = (result.solutions[name].estimate.theta for name in ('ols', 'cad'))
    rise = (regression.error(cad) ** 2 - regression.error(theta) ** 2) / 1e4
    difference = problem.cost(cad) - problem.cost(theta)
    assert difference == pytest.approx(rise, rel=1e-3)
