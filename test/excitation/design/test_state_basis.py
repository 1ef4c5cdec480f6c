"""States as linear functions of the coefficients."""

import numpy as np
import pytest

from aerarm_ros.excitation.design_problem import StateBasis
from aerarm_ros.excitation.trajectory import FourierTrajectory, RampedExcitation


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


def test_the_first_samples_cover_one_period_evenly(basis: StateBasis) -> None:
    period = basis.times[: basis.period_samples]
    np.testing.assert_allclose(np.diff(period), 10.0 / basis.period_samples)
    assert period[0] == 2.0
    assert basis.times.min() == 0.0
    assert basis.times.max() == pytest.approx(14.0)


def test_coefficients_round_trip(basis: StateBasis, trajectory: FourierTrajectory) -> None:
    back = basis.trajectory(basis.coefficients(trajectory))
    for field in ('q0', 'alpha', 'beta'):
        np.testing.assert_array_equal(getattr(back, field), getattr(trajectory, field))


def test_pull_back_is_the_transpose(basis: StateBasis) -> None:
    generator = np.random.default_rng(0)
    x = generator.normal(size=basis.shape)
    states = basis.states(x)
    gradients = [generator.normal(size=part.shape) for part in states]
    forward = sum((g * part).sum() for g, part in zip(gradients, states, strict=True))
    assert (basis.pull_back(*gradients) * x).sum() == pytest.approx(forward)
