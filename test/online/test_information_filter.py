import numpy as np
import pytest

from aerarm_ros.model.inertia import minimum_eigenvalue, parameters_of_body
from aerarm_ros.online.information_filter import SPECK, InformationFilter, nearest_body

TRUTH = np.array([0.5, -1.0, 2.0])


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(2)


def test_without_forgetting_it_is_regression_with_a_prior(random: np.random.Generator) -> None:
    recursive = InformationFilter(3)
    rows, values = random.normal(size=(40, 3)), random.normal(size=40)
    variances = random.uniform(0.5, 2.0, size=40)
    for pair in range(0, 40, 2):
        taken = slice(pair, pair + 2)
        recursive.update(rows[taken], values[taken], variances[taken], np.ones(3))
    information = np.eye(3) + rows.T @ (rows / variances[:, np.newaxis])
    mean = np.linalg.solve(information, rows.T @ (values / variances))
    np.testing.assert_allclose(recursive.belief.mean, mean)
    np.testing.assert_allclose(recursive.belief.covariance, np.linalg.inv(information))


def test_estimates_return_to_the_prior_at_their_own_rates(random: np.random.Generator) -> None:
    recursive = InformationFilter(3)
    rows = random.normal(size=(30, 3))
    recursive.update(rows, rows @ TRUTH, np.full(30, 1e-3), np.ones(3))
    kept = np.array([0.9, 0.999, 1.0])
    for _ in range(200):
        recursive.update(np.zeros((1, 3)), np.zeros(1), np.ones(1), kept)
    spread = np.sqrt(np.diag(recursive.belief.covariance))
    assert recursive.belief.mean[0] == pytest.approx(0.0, abs=1e-3)
    assert spread[0] == pytest.approx(1.0, abs=1e-3)
    assert recursive.belief.mean[1:] == pytest.approx(TRUTH[1:], abs=0.01)
    assert spread[1] < 0.05


SIZE = 0.15
BODY = parameters_of_body(0.2, [0.1, 0.01, -0.02], np.diag([2e-4, 3e-4, 4e-4]))
SCALE = 0.2 * np.array([1.0, *[SIZE] * 3, *[SIZE**2] * 6])


def test_where_nothing_is_known_it_is_a_ball_of_the_mass_and_centre() -> None:
    mean = np.concatenate([BODY[:4], np.zeros(6)])
    precise = [*[1e-3] * 4, *[1e3] * 6]
    found = nearest_body(mean, np.diag((precise * SCALE) ** -2.0), SIZE)
    np.testing.assert_allclose(found[:4] / SCALE[:4], BODY[:4] / SCALE[:4], atol=1e-3)
    assert minimum_eigenvalue(found) > 1e-6


@pytest.mark.parametrize('mass', [0.0, -0.3, SPECK / 2.0, np.nan])
def test_nothing_is_a_speck(mass: float) -> None:
    found = nearest_body(np.concatenate([[mass], BODY[1:]]), np.eye(10), SIZE)
    assert found[0] == SPECK
    assert minimum_eigenvalue(found) > 0.0


def test_whatever_is_estimated_it_is_a_body() -> None:
    random = np.random.default_rng(1)
    for _ in range(1000):
        factor = random.normal(size=(10, 10)) * 10.0 ** random.uniform(-2, 4, size=10)
        information = factor.T @ factor + np.eye(10)
        mean = SCALE * random.normal(size=10) * 10.0 ** random.uniform(-3, 2)
        found = nearest_body(mean, information, SIZE)
        assert np.isfinite(found).all()
        assert minimum_eigenvalue(found) > 0.0
