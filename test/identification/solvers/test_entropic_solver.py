"""The entropic prior: solid links, whatever the frame, and the best of them."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.regression.base_parameters import Prior
from aerarm_ros.identification.regression.regression import TriangularSystem
from aerarm_ros.identification.solvers.semidefinite_solver import solve_entropic, solve_semidefinite
from aerarm_ros.model.inertia import pseudo_inertia

SPREAD = 0.3


def links(theta: np.ndarray) -> np.ndarray:
    return pseudo_inertia(theta[:40].reshape(4, 10))


def divergence(theta: np.ndarray, prior: Prior) -> float:
    """Return the sum of tr(P P0^-1) - log det(P P0^-1) - 4 over the links."""
    ratio = links(theta) @ np.linalg.inv(links(prior.mean))
    sign, logarithm = np.linalg.slogdet(ratio)
    assert np.all(sign > 0.0)
    return float(np.sum(np.trace(ratio, axis1=1, axis2=2) - logarithm - 4.0))


def objective(system: TriangularSystem, prior: Prior, theta: np.ndarray) -> float:
    data = 0.5 * np.sum((system.R @ theta - system.z) ** 2)
    joints = 0.5 * np.sum(((theta - prior.mean) / prior.std)[40:] ** 2)
    return float(data + joints + divergence(theta, prior) / SPREAD**2)


def test_a_physical_arm_is_recovered(true, system_of, factor, prior, limits) -> None:
    found = solve_entropic(system_of(true, 1e4), prior, limits)
    assert np.linalg.norm(factor @ (found - true)) < 1e-3 * np.linalg.norm(factor @ true)


def test_without_data_cad_is_left(prior, limits) -> None:
    count = len(prior.mean)
    nothing = TriangularSystem(np.zeros((count, count)), np.zeros(count))
    found = solve_entropic(nothing, prior, limits)
    assert divergence(found, prior) < 1e-6
    assert np.allclose(found[40:], prior.mean[40:], atol=1e-6)


@pytest.mark.parametrize('seed', range(4))
def test_of_all_physical_arms_it_is_the_best(
    system_of, impossible, possible, prior, limits, seed: int
) -> None:
    random = np.random.default_rng(seed)
    system = system_of(impossible(random), 1e2)
    found = solve_entropic(system, prior, limits)
    best = objective(system, prior, found)
    for _ in range(50):
        nearby = found + 1e-3 * (possible(random) - found)
        assert objective(system, prior, nearby) > best * (1.0 - 1e-7)


def test_at_the_solution_the_objective_is_flat(true, system_of, prior, limits) -> None:
    # A likely arm, so that no bound holds it: data and prior balance each other.
    system = system_of(true, 10.0)
    found = solve_entropic(system, prior, limits)
    slopes, curvatures = [], []
    for index in range(40):
        step = np.zeros(len(found))
        step[index] = 1e-3 * prior.std[index]
        low, middle, high = (objective(system, prior, found + k * step) for k in (-1.0, 0.0, 1.0))
        slopes.append((high - low) / 2.0)
        curvatures.append(high - 2.0 * middle + low)
    # How far each parameter is from its best value, in steps.
    assert np.all(np.abs(slopes) < 0.2 * np.array(curvatures))


def test_links_are_solid_where_the_normal_prior_leaves_them_flat(
    system_of, impossible, prior, limits
) -> None:
    system = system_of(impossible(np.random.default_rng(0)), 1e2)
    solid, flat = (
        np.linalg.eigvalsh(links(solve(system, prior, limits))).min()
        for solve in (solve_entropic, solve_semidefinite)
    )
    assert solid > 100.0 * flat > 0.0


def test_the_unit_of_length_does_not_matter(system_of, factor, prior, limits) -> None:
    system = system_of(1.3 * prior.mean)
    other = replace(limits, size=3.0 * limits.size)
    first, second = (solve_entropic(system, prior, each) for each in (limits, other))
    assert np.linalg.norm(factor @ (first - second)) < 1e-4 * np.linalg.norm(factor @ first)


def test_same_input_same_bits(system_of, prior, limits) -> None:
    system = system_of(1.3 * prior.mean)
    first, second = (solve_entropic(system, prior, limits) for _ in range(2))
    assert np.array_equal(first, second)


def test_a_link_without_volume_in_the_urdf_is_rejected(system_of, prior, limits) -> None:
    mean = prior.mean.copy()
    mean[21:30] = 0.0  # link 3 is a point
    with pytest.raises(IdentificationError, match='link 3 in the URDF'):
        solve_entropic(system_of(mean), replace(prior, mean=mean), limits)
