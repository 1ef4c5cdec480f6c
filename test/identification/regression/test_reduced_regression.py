"""Triangular factors carry everything that least squares needs."""

import numpy as np
import pytest

from aerarm_ros.identification.regression.regression import ReducedRegression, triangular_factor

JOINTS, ROWS, COLUMNS = 3, 200, 7
NAMES = tuple('abcdefg')


@pytest.fixture(scope='module')
def data() -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    phi = random.standard_normal((JOINTS, ROWS, COLUMNS))
    phi[:, :, 6] = 2.0 * phi[:, :, 0]  # dependent
    return phi, random.standard_normal((JOINTS, ROWS))


@pytest.fixture(scope='module')
def regression(data) -> ReducedRegression:
    factors = [triangular_factor(np.column_stack(pair)) for pair in zip(*data, strict=True)]
    return ReducedRegression(NAMES, factors, [ROWS] * JOINTS)


@pytest.mark.parametrize('weights', [(1.0, 1.0, 1.0), (0.1, 2.0, 30.0)])
def test_the_reduced_problem_has_the_solution_of_the_full_one(data, regression, weights) -> None:
    phi, tau = data
    full = np.vstack([w * p for w, p in zip(weights, phi, strict=True)])
    right = np.concatenate([w * t for w, t in zip(weights, tau, strict=True)])
    expected = np.linalg.lstsq(full, right, rcond=1e-10)[0]
    system = regression.system(weights)
    assert np.allclose(np.linalg.lstsq(system.R, system.z, rcond=1e-10)[0], expected)


def test_norms_and_errors_are_those_of_all_rows(data, regression) -> None:
    phi, tau = data
    theta = np.linspace(-1.0, 1.0, COLUMNS)
    residual = tau - phi @ theta
    assert np.allclose(regression.residual_norms(theta), np.linalg.norm(residual, axis=1))
    assert np.allclose(regression.torque_norms, np.linalg.norm(tau, axis=1))
    assert np.allclose(regression.column_norms(), np.linalg.norm(phi, axis=1))
    expected = 100.0 * np.linalg.norm(residual) / np.linalg.norm(tau)
    assert regression.error(theta) == pytest.approx(expected)


def test_fewer_rows_than_columns() -> None:
    rows = np.random.default_rng(1).standard_normal((1, 2, 8))
    regression = ReducedRegression(NAMES, rows, [2])
    assert regression.system().R.shape == (7, 7)
