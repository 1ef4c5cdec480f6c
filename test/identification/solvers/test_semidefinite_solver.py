"""The semidefinite program finds physical arms, and the best one of them."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.regression.base_parameters import Prior
from aerarm_ros.identification.regression.regression import TriangularSystem
from aerarm_ros.identification.solvers.semidefinite_solver import solve_semidefinite
from aerarm_ros.model.inertia import minimum_eigenvalue, pseudo_inertia


def objective(system: TriangularSystem, prior: Prior, theta: np.ndarray) -> float:
    data = np.sum((system.R @ theta - system.z) ** 2)
    return float(data + np.sum(((theta - prior.mean) / prior.std) ** 2))


def test_a_physical_arm_is_recovered(true, system_of, factor, prior, limits) -> None:
    found = solve_semidefinite(system_of(true, 1e4), prior, limits)
    assert np.linalg.norm(factor @ (found - true)) < 1e-3 * np.linalg.norm(factor @ true)


def test_a_gear_loses_no_more_than_it_carries(true, system_of, prior, limits) -> None:
    """The twelve coefficients stand for anything here: two of them for friction per torque."""
    load = np.zeros(12, dtype=bool)
    load[[1, 6]] = True
    wanted = true.copy()
    wanted[[41, 46]] = 2.0, 0.4
    found = solve_semidefinite(system_of(wanted, 1e2), prior, replace(limits, load=load))
    assert 0.99 < found[41] <= 1.0
    assert found[46] == pytest.approx(0.4, abs=0.05)


@pytest.mark.parametrize('seed', range(4))
def test_an_impossible_arm_is_approached_from_the_possible_side(
    system_of, impossible, possible, prior, limits, seed: int
) -> None:
    random = np.random.default_rng(seed)
    wanted = impossible(random)
    system = system_of(wanted, 1e2)
    found = solve_semidefinite(system, prior, limits)
    inertial = found[:40].reshape(4, 10)
    assert minimum_eigenvalue(wanted[:40].reshape(4, 10)) < 0.0 < minimum_eigenvalue(inertial)
    assert np.all(found[40:] >= 0.0)
    ratio = inertial[:, 0] / limits.mass
    assert np.all((ratio > 0.5 - 1e-6) & (ratio < 2.0 + 1e-6))
    # Convex: no step towards any other physical arm makes it better.
    best = objective(system, prior, found)
    for _ in range(50):
        nearby = found + 1e-3 * (possible(random) - found)
        assert objective(system, prior, nearby) > best * (1.0 - 1e-7)


def test_without_data_cad_is_left(prior, limits) -> None:
    count = len(prior.mean)
    nothing = TriangularSystem(np.zeros((count, count)), np.zeros(count))
    found = solve_semidefinite(nothing, prior, limits)
    assert np.allclose(found, prior.mean, atol=1e-6 * prior.std.max())


def test_signs_are_free_where_they_may_be(system_of, prior, limits) -> None:
    free = replace(limits, nonnegative=np.zeros(12, dtype=bool))
    wanted = prior.mean.copy()
    wanted[45] = -0.4
    system = system_of(wanted, 1e3)
    assert solve_semidefinite(system, prior, free)[45] == pytest.approx(-0.4, abs=1e-3)
    assert solve_semidefinite(system, prior, limits)[45] >= 0.0


def test_same_input_same_bits(system_of, prior, limits) -> None:
    system = system_of(1.3 * prior.mean)
    first, second = (solve_semidefinite(system, prior, limits) for _ in range(2))
    assert np.array_equal(first, second)


def test_numbers_without_meaning_are_refused(factor, prior, limits) -> None:
    broken = replace(prior, std=np.full(len(prior.std), np.nan))
    with pytest.raises(IdentificationError, match='check'):
        solve_semidefinite(TriangularSystem(factor, factor[0]), broken, limits)


def test_the_cone_holds_the_pseudo_inertia(cad: ArmParameters) -> None:
    """The margin is far below the smallest eigenvalue that a real link has."""
    assert np.linalg.eigvalsh(pseudo_inertia(cad.inertial)).min() > 1e-5
