import numpy as np
import pytest

from aerarm_ros.online.information_filter import InformationFilter

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


def test_unexcited_parameters_stay_at_the_prior(random: np.random.Generator) -> None:
    recursive = InformationFilter(3)
    kept = np.full(3, 0.95)
    for _ in range(500):
        row = np.append(random.normal(size=2), 0.0)[np.newaxis]
        recursive.update(row, row @ TRUTH, np.full(1, 0.01), kept)
    belief = recursive.belief
    assert belief.mean[:2] == pytest.approx(TRUTH[:2], abs=0.01)
    assert belief.mean[2] == 0.0
    assert belief.covariance[2, 2] == pytest.approx(1.0)


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


def test_a_reset_of_some_parameters_keeps_the_others(random: np.random.Generator) -> None:
    recursive = InformationFilter(3)
    rows = random.normal(size=(30, 3))
    recursive.update(rows, rows @ TRUTH, np.full(30, 0.1), np.ones(3))
    before = recursive.belief
    recursive.forget(slice(0, 1))
    after = recursive.belief
    assert after.mean == pytest.approx([0.0, *before.mean[1:]])
    np.testing.assert_allclose(after.covariance[1:, 1:], before.covariance[1:, 1:])
    assert after.covariance[0] == pytest.approx([1.0, 0.0, 0.0])
    np.testing.assert_allclose(after.information @ after.covariance, np.eye(3), atol=1e-9)
