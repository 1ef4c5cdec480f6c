"""Derivatives of the whole program, its states, and constraints that are never too lenient."""

import numpy as np
import pytest

from aerarm_ros.excitation.design_problem import DesignProblem, StateBasis
from aerarm_ros.excitation.excitation_setup import RandomTrajectory
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation
from aerarm_ros.excitation.trajectory_designer import TrajectoryDesigner


@pytest.fixture(scope='module')
def problem(designer: TrajectoryDesigner) -> DesignProblem:
    return designer._problem


@pytest.fixture
def x(problem: DesignProblem, trajectory: FourierTrajectory) -> np.ndarray:
    return problem.basis.coefficients(trajectory).ravel()


def test_gradient_and_jacobian_by_central_differences(
    problem: DesignProblem, x: np.ndarray
) -> None:
    direction, step = np.random.default_rng(0).normal(size=x.size), 1e-5
    after, before = x + step * direction, x - step * direction
    numeric = (problem.value(after) - problem.value(before)) / (2.0 * step)
    assert problem.gradient(x) @ direction == pytest.approx(numeric, rel=1e-4)
    step = 2e-4  # distances are known to about 1e-6 m
    after, before = x + step * direction, x - step * direction
    numeric = (problem.constraints(after) - problem.constraints(before)) / (2.0 * step)
    np.testing.assert_allclose(problem.jacobian(x) @ direction, numeric, atol=2e-2)


def test_feasible_coefficients_respect_the_limits(
    problem: DesignProblem, designer: TrajectoryDesigner, candidates: RandomTrajectory
) -> None:
    generator = np.random.default_rng(4)
    limits = designer.specification.setup.usable_limits
    allowed = 0
    for scale in np.linspace(0.8, 3.0, 40):
        drawn = candidates.draw(generator)
        trajectory = FourierTrajectory(0.1, drawn.q0, scale * drawn.alpha, scale * drawn.beta)
        coefficients = problem.basis.coefficients(trajectory)
        if problem.constraints(coefficients.ravel()).min() < 0.0:
            continue
        allowed += 1
        states = problem.basis.states(coefficients)
        assert (np.abs(states.dq) <= limits.velocity).all()
        assert (np.abs(states.ddq) <= limits.acceleration).all()
        assert (states.q >= limits.position_min).all()
        assert (states.q <= limits.position_max).all()
    assert 3 < allowed < 40


@pytest.fixture(scope='module')
def basis() -> StateBasis:
    return StateBasis(0.1, 5, 4, ramp_time=2.0)


def test_states_are_those_of_the_played_trajectory(
    basis: StateBasis, trajectory: FourierTrajectory
) -> None:
    states = basis.states(basis.coefficients(trajectory))
    played = RampedExcitation(trajectory, 1, 2.0).evaluate(basis.times)
    for mine, theirs in zip(states, played, strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-12)
