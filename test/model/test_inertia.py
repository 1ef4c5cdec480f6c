"""Inertial parameters against bodies whose inertia is known, and thesis table A.1."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from aerarm_ros.model.inertia import (
    barycentric_inertia,
    cross,
    from_pseudo_inertia,
    inertia_about_origin,
    is_physically_consistent,
    joined,
    minimum_eigenvalue,
    pseudo_inertia,
)

finite = st.floats(-10.0, 10.0)


def point_masses(masses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Ten parameters of point masses, from the definitions of mass, moment and inertia."""
    pi = np.zeros(10)
    for m, p in zip(masses, points, strict=True):
        inertia = m * (p @ p * np.eye(3) - np.outer(p, p))
        upper = [inertia[i, j] for i, j in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
        pi += np.array([m, *(m * p), *upper])
    return pi


@given(arrays(float, 10, elements=finite))
def test_pseudo_inertia_is_undone(pi: np.ndarray) -> None:
    assert np.allclose(from_pseudo_inertia(pseudo_inertia(pi)), pi, rtol=1e-12, atol=1e-12)


@given(arrays(float, (6, 3), elements=finite), arrays(float, 6, elements=st.floats(0.0, 5.0)))
def test_any_distribution_of_mass_is_consistent(points: np.ndarray, masses: np.ndarray) -> None:
    pi = point_masses(masses, points)
    scale = 1.0 + np.abs(pi).max()
    assert is_physically_consistent(pi, tolerance=1e-12 * scale)


def test_parameters_are_those_of_pinocchio(rng: np.random.Generator) -> None:
    body = pin.Inertia.Random()
    pi = body.toDynamicParameters()
    assert np.allclose(barycentric_inertia(pi), body.inertia)
    assert np.allclose(inertia_about_origin(pi), body.matrix()[3:, 3:])
    assert np.allclose(pseudo_inertia(pi), body.toPseudoInertia().toMatrix())


def test_a_positive_tensor_can_still_break_the_triangle_inequality() -> None:
    pi = np.array([1.0, 0, 0, 0, 0.1, 0, 0.1, 0, 0, 0.3])
    assert np.all(np.linalg.eigvalsh(barycentric_inertia(pi)) > 0.0)
    assert not is_physically_consistent(pi)


def test_of_table_a1_only_the_cad_column_is_physical(table_a1: dict[str, np.ndarray]) -> None:
    cad, slsqp, annealed = (table_a1[k][:40].reshape(4, 10) for k in ('CAD', 'SLSQP', 'SA'))
    assert is_physically_consistent(cad)
    assert minimum_eigenvalue(cad) == pytest.approx(1.6e-5, abs=1e-6)
    assert not any(is_physically_consistent(link) for link in slsqp)
    assert minimum_eigenvalue(slsqp) == pytest.approx(-1.9e-4, abs=1e-5)
    smallest = np.linalg.eigvalsh(barycentric_inertia(annealed))[:, 0]
    assert np.all(smallest < 0.0)
    assert smallest[1] == pytest.approx(-0.139, abs=1e-3)


def test_the_inertia_of_joined_bodies_agrees_with_pinocchio() -> None:
    bodies = [pin.Inertia.Random() for _ in range(3)]
    mass, centre, inertia = joined(*((body.mass, body.lever, body.inertia) for body in bodies))
    expected = bodies[0] + bodies[1] + bodies[2]
    assert mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(centre, expected.lever, atol=1e-12)
    np.testing.assert_allclose(inertia, expected.inertia, atol=1e-12)


def test_the_cross_product_is_numpys_to_the_bit() -> None:
    random = np.random.default_rng(0)
    for a, b in random.normal(size=(20, 2, 3)):
        np.testing.assert_array_equal(cross(a, b), np.cross(a, b))
