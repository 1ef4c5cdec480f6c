"""The semidefinite programs find physical arms and the best of them, within bounds if possible."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.joint_model import LinkBounds, inertia_boxes
from aerarm_ros.identification.model_fit import Prior
from aerarm_ros.identification.regression import TriangularSystem
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.semidefinite_solver import (
    solve_entropic,
    solve_relaxed,
    solve_semidefinite,
)
from aerarm_ros.identification.solvers.solvers import physical_limits, solve_all
from aerarm_ros.model.inertia import minimum_eigenvalue, pseudo_inertia

SPREAD = 0.3


def links(theta: np.ndarray) -> np.ndarray:
    return pseudo_inertia(theta[:40].reshape(4, 10))


def divergence(theta: np.ndarray, prior: Prior) -> float:
    """Return the sum of tr(P P0^-1) - log det(P P0^-1) - 4 over the links."""
    ratio = links(theta) @ np.linalg.inv(links(prior.mean))
    sign, logarithm = np.linalg.slogdet(ratio)
    assert np.all(sign > 0.0)
    return float(np.sum(np.trace(ratio, axis1=1, axis2=2) - logarithm - 4.0))


def objective(solve: Callable, system: TriangularSystem, prior: Prior, theta: np.ndarray) -> float:
    """Return what a solver minimizes: torque error plus distance from the prior."""
    squares = ((theta - prior.mean) / prior.std) ** 2
    distance = squares.sum()
    if solve is solve_entropic:
        distance = squares[40:].sum() + 2.0 * divergence(theta, prior) / SPREAD**2
    return float(np.sum((system.R @ theta - system.z) ** 2) + distance)


def test_a_gear_loses_no_more_than_it_carries(true, system_of, prior, limits) -> None:
    """The twelve coefficients stand for anything here: two of them for friction per torque."""
    load = np.zeros(12, dtype=bool)
    load[[1, 6]] = True
    wanted = true.copy()
    wanted[[41, 46]] = 2.0, 0.4
    found = solve_semidefinite(system_of(wanted, 1e2), prior, replace(limits, load=load))
    assert 0.99 < found[41] <= 1.0
    assert found[46] == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize('solve', [solve_semidefinite, solve_entropic])
@pytest.mark.parametrize('seed', range(4))
def test_an_impossible_arm_is_approached_from_the_possible_side(
    system_of, impossible, possible, prior, limits, seed: int, solve: Callable
) -> None:
    random = np.random.default_rng(seed)
    wanted = impossible(random)
    system = system_of(wanted, 1e2)
    found = solve(system, prior, limits)
    inertial = found[:40].reshape(4, 10)
    assert minimum_eigenvalue(wanted[:40].reshape(4, 10)) < 0.0 < minimum_eigenvalue(inertial)
    assert np.all(found[40:] >= 0.0)
    ratio = inertial[:, 0] / limits.mass
    assert np.all((ratio > 0.5 - 1e-6) & (ratio < 2.0 + 1e-6))
    if solve is solve_entropic:  # solid where the normal prior leaves links flat
        flat = solve_semidefinite(system, prior, limits)[:40].reshape(4, 10)
        assert minimum_eigenvalue(inertial) > 100.0 * minimum_eigenvalue(flat)
    # Convex: no step towards any other physical arm makes it better.
    best = objective(solve, system, prior, found)
    for _ in range(50):
        nearby = found + 1e-3 * (possible(random) - found)
        assert objective(solve, system, prior, nearby) > best * (1.0 - 1e-7)


def test_numbers_without_meaning_are_refused(factor, prior, limits) -> None:
    broken = replace(prior, std=np.full(len(prior.std), np.nan))
    with pytest.raises(IdentificationError, match='check'):
        solve_semidefinite(TriangularSystem(factor, factor[0]), broken, limits)


@pytest.mark.parametrize('solve', [solve_semidefinite, solve_entropic])
def test_a_physical_arm_is_recovered_and_without_data_cad_is_left(
    true, system_of, factor, prior, limits, solve: Callable
) -> None:
    found = solve(system_of(true, 1e4), prior, limits)
    assert np.linalg.norm(factor @ (found - true)) < 1e-3 * np.linalg.norm(factor @ true)
    count = len(prior.mean)
    nothing = TriangularSystem(np.zeros((count, count)), np.zeros(count))
    left, again = (solve(nothing, prior, limits) for _ in range(2))
    assert divergence(left, prior) < 1e-6
    if solve is solve_semidefinite:
        assert np.allclose(left, prior.mean, atol=1e-6 * prior.std.max())
    assert np.allclose(left[40:], prior.mean[40:], atol=1e-6)
    assert np.array_equal(left, again)


def bounded(result: IdentificationResult, bounds: LinkBounds) -> Estimate:
    return solve_all(result.fit, result.cad, names=(), bounds=bounds)['sdp']


def test_bounds_are_met(result: IdentificationResult) -> None:
    total = 1.2 * result.cad.inertial[:, 0].sum()
    estimate = bounded(result, LinkBounds((total, 1.01 * total), centres=True))
    assert estimate.notes == ()
    assert estimate.physically_consistent
    assert total * (1 - 1e-6) <= estimate.inertial[:, 0].sum() <= 1.01 * total * (1 + 1e-6)
    centre, reach = inertia_boxes(result.cad.inertial)
    centres = estimate.inertial[:, 1:4] / estimate.inertial[:, :1]
    assert np.all(np.abs(centres - centre) <= reach + 1e-6)


def test_an_impossible_total_mass_is_dropped_and_the_centres_are_kept(
    result: IdentificationResult,
) -> None:
    estimate = bounded(result, LinkBounds((300.0, 310.0), centres=True))
    (note,) = estimate.notes
    assert 'no solution was found' in note
    assert 'with masses within a factor 2' in note
    assert 'total mass 300 .. 310 kg' in note
    alone = bounded(result, LinkBounds(centres=True))
    assert alone.notes == ()
    assert np.array_equal(estimate.theta, alone.theta)


def test_impossible_centres_are_dropped_first(result: IdentificationResult) -> None:
    """No link has its matter at these centres, unless it is moved far against the data."""
    total = float(result.cad.inertial[:, 0].sum())
    bounds = LinkBounds((total, 1.01 * total), centres=True)
    limits = physical_limits(result.fit, result.cad, bounds)
    far = replace(limits, centre=limits.centre + 1e9, reach=0.0 * limits.reach)
    system = result.fit.regression.system(result.fit.noise.weights)
    theta, (note,) = solve_relaxed(system, result.fit.prior, far)
    assert 'bounds of the centres of mass' in note
    masses = theta[: 10 * result.fit.model.n : 10]
    assert total * (1 - 1e-6) <= masses.sum() <= 1.01 * total * (1 + 1e-6)


def test_the_unit_of_length_does_not_matter(system_of, factor, prior, limits) -> None:
    system = system_of(1.3 * prior.mean)
    other = replace(limits, size=3.0 * limits.size)
    first, second = (solve_entropic(system, prior, each) for each in (limits, other))
    assert np.linalg.norm(factor @ (first - second)) < 1e-4 * np.linalg.norm(factor @ first)
