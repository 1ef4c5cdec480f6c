"""The base's motion from IMU samples, and the fallback to gravity without them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample, Mount
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.checks import RejectedInputError

GRAVITY = np.array([0.0, 0.0, -9.81])
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def sample(stamp, attitude=LEVEL, rate=(0.0, 0.0, 0.0), force=(0.0, 0.0, 9.81)) -> ImuSample:
    return ImuSample(stamp, attitude, np.array(rate), np.array(force))


def test_attitude_turns_gravity() -> None:
    estimator = BaseMotionEstimator(GRAVITY, 'attitude')
    tilt = Rotation.from_euler('x', 0.5)
    estimator.offer(sample(0.0, tilt.as_quat()), 0.0)
    motion = estimator.motion(0.0)
    np.testing.assert_allclose(motion.gravity, tilt.inv().apply(GRAVITY))
    np.testing.assert_allclose(motion.specific_force, -motion.gravity)
    assert not motion.angular_velocity.any()


def test_silence_is_held_then_fades_to_the_configured_gravity() -> None:
    estimator = BaseMotionEstimator(GRAVITY, 'attitude', hold_time=0.1, fade_time=0.5)
    tilt = Rotation.from_euler('y', 0.6).as_quat()
    estimator.offer(sample(0.0, tilt), 0.0)
    times = np.arange(0.0, 1.0, 1e-3)
    gravity = np.array([estimator.motion(t).gravity for t in times])
    np.testing.assert_allclose(gravity[:100], np.tile(gravity[0], (100, 1)))
    np.testing.assert_allclose(gravity[-1], GRAVITY)
    assert np.abs(np.diff(gravity, axis=0)).max() < 0.03
    assert estimator.status(0.05) == 'IMU'
    assert 'no IMU sample for' in estimator.status(0.9)
    # And back again, as smoothly.
    back = []
    for t in np.arange(1.0, 2.0, 1e-3):
        estimator.offer(sample(t, tilt), t)
        back.append(estimator.motion(t).gravity)
    assert np.abs(np.diff([gravity[-1], *back], axis=0)).max() < 0.03
    np.testing.assert_allclose(back[-1], gravity[0])


def test_a_sample_is_turned_on_by_its_age_and_the_latency() -> None:
    rate = np.array([2.0, 0.0, 0.0])
    level = Rotation.identity().as_quat()
    late = BaseMotionEstimator(GRAVITY, 'full', fade_time=1e6, latency=0.010)
    late.offer(sample(0.0, level, rate, -GRAVITY), 0.0)
    there = Rotation.from_rotvec(0.015 * rate).inv().apply(GRAVITY)
    np.testing.assert_allclose(late.motion(0.005).gravity, there, atol=1e-4)
    np.testing.assert_allclose(late.motion(0.005).specific_force, -there, atol=1e-4)
    # An IMU that has fallen silent is not believed to turn for ever.
    np.testing.assert_allclose(late.motion(0.1).gravity, late.motion(0.2).gravity, atol=1e-5)


class Swing:
    """A drone that rolls to and fro with its thrust along its own z axis, and sways."""

    rate, amplitude = np.pi, 0.5  # [rad/s], [rad]

    def __init__(self, imu_position=(0.0, 0.0, 0.0)) -> None:
        self._position = np.array(imu_position)

    def spin(self, time: float) -> np.ndarray:
        return np.array([-self.amplitude * self.rate**2 * np.sin(self.rate * time), 0.0, 0.0])

    def velocity(self, time: float) -> np.ndarray:
        return np.array([self.amplitude * self.rate * np.cos(self.rate * time), 0.0, 0.0])

    def force(self, time: float) -> np.ndarray:
        """Return the specific force at the base's origin."""
        return np.array([2.0 * np.sin(self.rate * time), 1.0, 9.81 + np.cos(self.rate * time)])

    def sample(self, time: float) -> ImuSample:
        w = self.velocity(time)
        lever = np.cross(self.spin(time), self._position)
        lever += np.cross(w, np.cross(w, self._position))
        return sample(time, rate=w, force=self.force(time) + lever)


@pytest.mark.parametrize('position', [(0.0, 0.0, 0.0), (0.05, 0.1, 0.15)])
def test_the_motion_of_a_swinging_drone_is_estimated_without_lag(position) -> None:
    swing, ahead, errors = Swing(position), 0.003, []
    mount = Mount(np.eye(3), np.array(position))
    estimator = BaseMotionEstimator(GRAVITY, 'full', mount)
    for time in np.arange(0.0, 6.0, 0.004):
        estimator.offer(swing.sample(time), time)
        motion, then = estimator.motion(time, ahead), time + ahead
        spin = motion.angular_acceleration - swing.spin(then)
        errors.append([*np.abs(spin), *np.abs(motion.specific_force - swing.force(then))])
    spin, force = np.split(np.array(errors[250:]).max(axis=0), 2)
    # Lags of 7.7 and 3 ms would leave 0.12 rad/s^2 and 0.019 m/s^2; the lever multiplies the
    # error of the angular acceleration.
    assert spin.max() < 0.3 * 0.12
    assert force.max() < 0.4 * 0.019 + spin.max() * np.linalg.norm(position)


def test_a_gap_does_not_amplify_the_noise() -> None:
    random, estimator = np.random.default_rng(0), BaseMotionEstimator(GRAVITY, 'full')
    fresh, old = [], []
    for time in np.arange(0.0, 4.0, 0.004):
        rate, force = 0.005 * random.standard_normal(3), 0.5 * random.standard_normal(3)
        estimator.offer(sample(time, rate=rate, force=force - GRAVITY), time)
        # As if no other came: what is asked later does not change what is asked now.
        for motions, age in ((fresh, 0.004), (old, 0.09)):
            motions.append(np.concatenate(estimator.motion(time + age)[1:]))
    spread = [np.std(motions[100:], axis=0) for motions in (fresh, old)]
    assert np.all(spread[1][[0, 1, 2, 6, 7, 8]] < 1.35 * spread[0][[0, 1, 2, 6, 7, 8]])


def test_rejected_samples_change_nothing() -> None:
    estimator = BaseMotionEstimator(GRAVITY, 'attitude')
    estimator.offer(sample(1.0), 1.0)
    before: BaseMotion = estimator.motion(1.0)
    with pytest.raises(RejectedInputError, match='not newer'):
        estimator.offer(sample(0.9, Rotation.from_euler('x', 1.0).as_quat()), 1.0)
    with pytest.raises(RejectedInputError, match='no attitude'):
        estimator.offer(sample(1.1, attitude=None), 1.1)
    np.testing.assert_array_equal(estimator.motion(1.01).gravity, before.gravity)
