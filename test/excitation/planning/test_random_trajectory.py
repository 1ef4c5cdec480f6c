"""Seeded draws inside the limits, and clear errors if none is feasible."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.excitation.excitation_setup import RandomTrajectory
from aerarm_ros.excitation.feasibility import FeasibilityChecker
from aerarm_ros.excitation.settings import ExcitationError, InfeasibleError

RAMP = 2.0


def test_the_same_seed_gives_the_same_trajectory(
    candidates: RandomTrajectory, checker: FeasibilityChecker
) -> None:
    first, again, other = (candidates.draw_feasible(seed, checker, RAMP)[0] for seed in (7, 7, 8))
    for field in ('q0', 'alpha', 'beta'):
        np.testing.assert_array_equal(getattr(first, field), getattr(again, field))
        assert (getattr(first, field) != getattr(other, field)).any()


def test_a_wild_draw_is_rejected_until_it_is_feasible(
    candidates: RandomTrajectory, checker: FeasibilityChecker
) -> None:
    wild = replace(candidates, amplitude=0.6)
    first = wild.draw(np.random.default_rng(0))
    assert not checker.check_trajectory(first, RAMP).feasible
    trajectory, report = wild.draw_feasible(0, checker, RAMP)
    assert report.feasible
    assert checker.check_trajectory(trajectory, RAMP).feasible


def test_joint_2_is_centred_upright_plus_a_random_term(
    candidates: RandomTrajectory, config
) -> None:
    generator = np.random.default_rng(1)
    bias = np.array([candidates.draw(generator).q0 for _ in range(50)])
    assert np.abs(bias[:, 1] - np.pi / 2).max() <= config.bias_spread
    assert np.ptp(bias[:, 1]) > config.bias_spread


@pytest.mark.parametrize(
    ('change', 'limit'),
    [
        ({'amplitude': 3.0}, 'velocity|position|torque'),
        ({'fundamental': 0.35}, 'acceleration|velocity|torque'),
        ({'fundamental': 1.0}, 'frequency of highest harmonic'),
        ({'bias': np.array([0.0, -0.4, 0.0, 0.0])}, 'position of joint2|ground clearance'),
    ],
)
def test_infeasible_limits_name_the_one_that_binds(
    candidates: RandomTrajectory, checker: FeasibilityChecker, change: dict, limit: str
) -> None:
    with pytest.raises(InfeasibleError, match=limit) as caught:
        replace(candidates, **change).draw_feasible(0, checker, RAMP, attempts=10)
    assert 'exceeds its limit in' in str(caught.value)


@pytest.mark.parametrize('change', [{'amplitude': 0.0}, {'harmonics': 0}])
def test_wrong_numbers_are_refused(candidates: RandomTrajectory, change: dict) -> None:
    with pytest.raises(ExcitationError):
        replace(candidates, **change)
