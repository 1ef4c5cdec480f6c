from importlib import import_module

import numpy as np
import pytest

from aerarm_ros.model.inertia import minimum_eigenvalue, parameters_of_body
from aerarm_ros.online.information_filter import SPECK, nearest_body

SIZE = 0.15
BODY = parameters_of_body(0.2, [0.1, 0.01, -0.02], np.diag([2e-4, 3e-4, 4e-4]))
SCALE = 0.2 * np.array([1.0, *[SIZE] * 3, *[SIZE**2] * 6])


def test_an_accurate_body_is_unchanged() -> None:
    information = np.diag((1e-3 * SCALE) ** -2.0)
    found = nearest_body(BODY, information, SIZE)
    np.testing.assert_allclose(found / SCALE, BODY / SCALE, atol=2e-4)


def test_where_nothing_is_known_it_is_a_ball_of_the_mass_and_centre() -> None:
    mean = np.concatenate([BODY[:4], np.zeros(6)])
    precise = [*[1e-3] * 4, *[1e3] * 6]
    found = nearest_body(mean, np.diag((precise * SCALE) ** -2.0), SIZE)
    np.testing.assert_allclose(found[:4] / SCALE[:4], BODY[:4] / SCALE[:4], atol=1e-3)
    assert minimum_eigenvalue(found) > 1e-6


def test_few_steps_of_newton_do_as_well_as_many(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(0)
    factor = random.normal(size=(10, 10)) / SCALE
    mean = BODY + SCALE * random.normal(scale=0.3, size=10)
    few = nearest_body(mean, factor.T @ factor, SIZE)
    monkeypatch.setattr(import_module('aerarm_ros.online.information_filter'), '_ITERATIONS', 200)
    many = nearest_body(mean, factor.T @ factor, SIZE)
    np.testing.assert_allclose(factor @ few, factor @ many, atol=0.05)


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
