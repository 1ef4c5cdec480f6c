"""A payload's figures follow from its ten parameters."""

import numpy as np
import pytest

from aerarm_ros.identification.payload import Payload
from aerarm_ros.model.inertia import from_pseudo_inertia

MASS, CENTRE = 0.4, np.array([0.1, -0.05, 0.02])


@pytest.fixture
def payload() -> Payload:
    point = np.append(CENTRE, 1.0)
    matter = MASS * (np.outer(point, point) + np.diag([1e-4, 2e-4, 3e-4, 0.0]))
    covariance = np.diag(np.linspace(1e-4, 1e-3, 10) ** 2)
    return Payload('hand', from_pseudo_inertia(matter), covariance)


def test_mass_centre_and_inertia(payload: Payload) -> None:
    assert payload.mass == pytest.approx(MASS)
    assert payload.centre == pytest.approx(CENTRE)
    expected = MASS * np.array([5e-4, 4e-4, 3e-4])
    assert np.diag(payload.barycentric_inertia) == pytest.approx(expected)


def test_deviation_of_the_centre_is_that_of_samples(payload: Payload) -> None:
    random = np.random.default_rng(0)
    samples = random.multivariate_normal(payload.inertial, payload.covariance, 20_000)
    centres = samples[:, 1:4] / samples[:, :1]
    assert payload.centre_std == pytest.approx(centres.std(axis=0), rel=0.05)
