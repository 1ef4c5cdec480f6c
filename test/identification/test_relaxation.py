"""Bounds are met, or given up in order and said so."""

import numpy as np
import pytest

from aerarm_ros.identification.estimate import Estimate
from aerarm_ros.identification.identification_error import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.inertia_boxes import inertia_boxes
from aerarm_ros.identification.link_bounds import LinkBounds
from aerarm_ros.identification.solvers import solve_all


def solve(result: IdentificationResult, bounds: LinkBounds) -> Estimate:
    return solve_all(result.fit, result.cad, names=(), bounds=bounds)['sdp']


def test_bounds_are_met(result: IdentificationResult) -> None:
    total = 1.2 * result.cad.inertial[:, 0].sum()
    estimate = solve(result, LinkBounds((total, 1.01 * total), centres=True))
    assert estimate.notes == ()
    assert estimate.physically_consistent
    assert total * (1 - 1e-6) <= estimate.inertial[:, 0].sum() <= 1.01 * total * (1 + 1e-6)
    boxes = inertia_boxes(result.cad.inertial)
    centres = estimate.inertial[:, 1:4] / estimate.inertial[:, :1]
    assert np.all(np.abs(centres - boxes.centre) <= boxes.reach + 1e-6)


def test_an_impossible_total_mass_is_given_up_last(result: IdentificationResult) -> None:
    estimate = solve(result, LinkBounds((50.0, 51.0), centres=True))
    assert len(estimate.notes) == 2
    assert 'centres of mass' in estimate.notes[0]
    assert 'total mass 50 .. 51 kg' in estimate.notes[1]
    assert np.array_equal(estimate.theta, result.recommended.estimate.theta)


@pytest.mark.parametrize('masses', [(2.0, 1.0), (-1.0, 1.0), (0.0, float('nan'))])
def test_wrong_masses_are_refused(masses: tuple[float, float]) -> None:
    with pytest.raises(IdentificationError, match='total mass'):
        LinkBounds(masses)
