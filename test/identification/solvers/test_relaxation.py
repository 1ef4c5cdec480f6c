"""Bounds are met, or given up in order and said so."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.arm_parameters import LinkBounds, inertia_boxes
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.solvers.estimate import Estimate, PhysicalLimits
from aerarm_ros.identification.solvers.semidefinite_solver import solve_relaxed
from aerarm_ros.identification.solvers.solvers import physical_limits, solve_all


def solve(result: IdentificationResult, bounds: LinkBounds) -> Estimate:
    return solve_all(result.fit, result.cad, names=(), bounds=bounds)['sdp']


def test_bounds_are_met(result: IdentificationResult) -> None:
    total = 1.2 * result.cad.inertial[:, 0].sum()
    estimate = solve(result, LinkBounds((total, 1.01 * total), centres=True))
    assert estimate.notes == ()
    assert estimate.physically_consistent
    assert total * (1 - 1e-6) <= estimate.inertial[:, 0].sum() <= 1.01 * total * (1 + 1e-6)
    centre, reach = inertia_boxes(result.cad.inertial)
    centres = estimate.inertial[:, 1:4] / estimate.inertial[:, :1]
    assert np.all(np.abs(centres - centre) <= reach + 1e-6)


def test_an_impossible_total_mass_is_dropped_and_the_centres_are_kept(
    result: IdentificationResult,
) -> None:
    estimate = solve(result, LinkBounds((300.0, 310.0), centres=True))
    (note,) = estimate.notes
    assert 'no solution was found' in note
    assert 'with masses within a factor 2' in note
    assert 'total mass 300 .. 310 kg' in note
    alone = solve(result, LinkBounds(centres=True))
    assert alone.notes == ()
    assert np.array_equal(estimate.theta, alone.theta)


def far_off(limits: PhysicalLimits) -> PhysicalLimits:
    """Centres of mass where no link has its matter, unless it is moved far against the data."""
    return replace(limits, centre=limits.centre + 1e9, reach=0.0 * limits.reach)


def test_impossible_centres_are_dropped_first(result: IdentificationResult) -> None:
    total = float(result.cad.inertial[:, 0].sum())
    bounds = LinkBounds((total, 1.01 * total), centres=True)
    limits = far_off(physical_limits(result.fit, result.cad, bounds))
    system = result.fit.regression.system(result.fit.noise.weights)
    theta, notes = solve_relaxed(system, result.fit.prior, limits)
    assert len(notes) == 1
    assert 'bounds of the centres of mass' in notes[0]
    masses = theta[: 10 * result.fit.model.n : 10]
    assert total * (1 - 1e-6) <= masses.sum() <= 1.01 * total * (1 + 1e-6)


@pytest.mark.parametrize('masses', [(2.0, 1.0), (-1.0, 1.0), (0.0, float('nan'))])
def test_wrong_masses_are_refused(masses: tuple[float, float]) -> None:
    with pytest.raises(IdentificationError, match='total mass'):
        LinkBounds(masses)
