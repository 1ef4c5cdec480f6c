"""A payload is weighed by moving it."""

from dataclasses import replace

import numpy as np
import pytest
from identified import identified

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.payload import (
    Payload,
    calibrate_gains,
    identify_payload,
    weigh_payload,
)
from aerarm_ros.model.inertia import from_pseudo_inertia, is_physically_consistent

MASS, CENTRE = 0.2, np.array([0.1, 0.01, -0.02])


POINT = np.append(CENTRE, 1.0)
BODY = from_pseudo_inertia(MASS * (np.outer(POINT, POINT) + np.diag([2e-4, 3e-4, 4e-4, 0.0])))


def test_mass_centre_and_inertia_with_the_deviation_of_samples() -> None:
    payload = Payload('hand', BODY, np.diag(np.linspace(1e-4, 1e-3, 10) ** 2))
    assert payload.mass == pytest.approx(MASS)
    assert payload.centre == pytest.approx(CENTRE)
    assert np.diag(payload.barycentric_inertia) == pytest.approx(
        MASS * np.array([7e-4, 6e-4, 5e-4])
    )
    random = np.random.default_rng(0)
    samples = random.multivariate_normal(payload.inertial, payload.covariance, 20_000)
    centres = samples[:, 1:4] / samples[:, :1]
    assert payload.centre_std == pytest.approx(centres.std(axis=0), rel=0.05)


def loaded(arm):
    inertial = arm.inertial.copy()
    inertial[-1] += BODY
    return replace(arm, inertial=inertial)


@pytest.mark.parametrize('seed', [2, 3])
def test_a_fifth_of_a_kilogram_is_found(arm, result: IdentificationResult, seed: int) -> None:
    payload = identify_payload(result, [loaded(arm).recording(seed, noise=1.0)])
    assert payload.link == 'link4'
    assert payload.mass == pytest.approx(MASS, rel=0.02)
    assert payload.centre == pytest.approx(CENTRE, abs=5e-3)
    assert is_physically_consistent(payload.inertial)
    deviations = (payload.inertial - BODY) / payload.std
    assert np.abs(deviations).max() < 5.0
    assert np.all(payload.centre_std < 0.01)


def test_the_deviation_includes_that_of_the_torque_constants(
    arm, result: IdentificationResult
) -> None:
    motion = loaded(arm).recording(2, noise=1.0)
    exact = identify_payload(result, [motion])
    stated = identify_payload(result, [motion], gain_deviation=0.1)
    np.testing.assert_array_equal(stated.inertial, exact.inertial)
    assert 0.1 * MASS < stated.std[0] < 0.13 * MASS
    assert np.all(stated.std >= exact.std)
    with pytest.raises(IdentificationError, match='no payload found'):  # an empty hand
        identify_payload(result, [arm.recording(2, noise=1.0)])
    for mass in (0.0, -1.0, float('nan')):
        with pytest.raises(IdentificationError, match='kg must be positive and finite'):
            calibrate_gains(
                result.robot, result.recommended.estimate, [], ConditioningOptions(), mass, 0.1
            )


@pytest.mark.parametrize('factors', [[0.85, 0.87, 0.84, 0.88], [1.1, 1.1, 1.1, 1.1]])
def test_a_known_mass_calibrates_the_torque_constants(
    factors: list[float], arm, robot: Robot
) -> None:
    scaled = [
        replace(motion, tau=motion.tau * factors)
        for motion in (arm.recording(1, noise=0.5), loaded(arm).recording(2, noise=0.5))
    ]
    wrong = identified(scaled[0]).recommended.estimate
    options = ConditioningOptions()
    before = weigh_payload(robot, wrong, [scaled[1]], options)
    assert abs(before.mass / MASS - 1.0) > 0.05
    found = calibrate_gains(robot, wrong, [scaled[1]], options, MASS, 0.1)
    assert found.payload.centre == pytest.approx(CENTRE, abs=0.01)
    # Joint 1 turns about the vertical axis and feels little of the mass.
    assert found.factors[1:] * factors[1:] == pytest.approx(1.0, abs=0.03)
    right = [replace(motion, tau=motion.tau * found.factors) for motion in scaled]
    known = identified(right[0]).recommended.estimate
    after = weigh_payload(robot, known, [right[1]], options)
    assert after.mass == pytest.approx(MASS, rel=0.02)
