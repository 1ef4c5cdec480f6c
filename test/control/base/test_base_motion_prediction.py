"""Prediction of an IMU's readings at the base."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.base_motion_estimator import BaseMotionPrediction

RATE = np.array([0.4, -1.5, 0.8])
GRAVITY_IN_WORLD = np.array([0.0, 0.0, -9.81])
FORCE_IN_WORLD = np.array([1.0, -2.0, 10.5])
START = Rotation.from_rotvec([0.3, 0.2, -0.5])


def motion_at(time: float) -> BaseMotion:
    """Return the motion of a base with a constant rate under a constant force."""
    to_base = (START * Rotation.from_rotvec(time * RATE)).inv()
    gravity, force = to_base.apply([GRAVITY_IN_WORLD, FORCE_IN_WORLD])
    return BaseMotion(gravity, force, RATE, np.zeros(3))


@pytest.mark.parametrize('time', [0.0, 0.002, 0.02])
def test_vectors_constant_in_the_world_rotate_against_the_base(time: float) -> None:
    predicted = BaseMotionPrediction(motion_at(0.0), RATE).after(time)
    error = (np.linalg.norm(RATE) * time) ** 3 * 10.0
    for now, then in zip(predicted, motion_at(time), strict=True):
        np.testing.assert_allclose(now, then, atol=error + 1e-12)


def test_a_force_with_a_trend_follows_it_and_does_not_turn() -> None:
    measured, slope = motion_at(0.0), np.array([3.0, -8.0, 5.0])
    predicted = BaseMotionPrediction(measured, RATE, slope).after(0.01)
    np.testing.assert_allclose(predicted.specific_force, measured.specific_force + 0.01 * slope)
    np.testing.assert_allclose(predicted.gravity, motion_at(0.01).gravity, atol=1e-4)


def test_trends_end_after_a_while() -> None:
    slope, jerk = np.array([3.0, -8.0, 5.0]), np.array([10.0, 0.0, -20.0])
    prediction = BaseMotionPrediction(motion_at(0.0), RATE, slope, jerk)
    early, late = prediction.after(0.02), prediction.after(0.1)
    np.testing.assert_array_equal(late.specific_force, early.specific_force)
    np.testing.assert_array_equal(late.angular_acceleration, early.angular_acceleration)
    np.testing.assert_allclose(
        late.angular_velocity, early.angular_velocity + 0.08 * early.angular_acceleration
    )


def test_an_angular_acceleration_that_grows_is_followed() -> None:
    spin, jerk = np.array([1.0, 2.0, 3.0]), np.array([10.0, 0.0, -20.0])
    measured = motion_at(0.0)._replace(angular_acceleration=spin)
    predicted = BaseMotionPrediction(measured, RATE, jerk=jerk).after(0.01)
    np.testing.assert_allclose(predicted.angular_acceleration, spin + 0.01 * jerk)
    np.testing.assert_allclose(predicted.angular_velocity, RATE + 0.01 * spin + 5e-5 * jerk)


def test_the_rate_changes_with_the_angular_acceleration() -> None:
    spin = np.array([1.0, 2.0, 3.0])
    measured = motion_at(0.0)._replace(angular_acceleration=spin)
    predicted = BaseMotionPrediction(measured, RATE).after(0.01)
    np.testing.assert_allclose(predicted.angular_velocity, RATE + 0.01 * spin)
    np.testing.assert_array_equal(predicted.angular_acceleration, spin)
