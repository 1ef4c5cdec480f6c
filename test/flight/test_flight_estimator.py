"""Accepted and rejected samples of odometry and IMU, with reasons."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import PoseConfig, load_drone_config
from aerarm_ros.flight.flight_estimator import SILENCE, FlightEstimator
from aerarm_ros.flight.flight_state import OdometrySample

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
ZERO = np.zeros(3)
UP = np.array([0.0, 0.0, 9.81])
DRONE = replace(load_drone_config(), imu=PoseConfig((0.0, 0.0, 0.0), (0.0, 0.0, np.pi / 2)))
TO_IMU = DRONE.imu.rotation.T


def odometry(stamp: float, **changes: object) -> OdometrySample:
    values = {'position': ZERO, 'attitude': LEVEL, 'velocity': ZERO, 'rate': ZERO, **changes}
    return OdometrySample(stamp, *values.values())


def imu(stamp: float, rate: np.ndarray = ZERO, attitude: np.ndarray | None = None) -> ImuSample:
    jitter = 1e-6 * np.array([stamp, 0.0, 0.0])
    return ImuSample(stamp, attitude, TO_IMU @ rate + jitter, UP)


@pytest.fixture
def estimator() -> FlightEstimator:
    return FlightEstimator(DRONE)


def feed(estimator: FlightEstimator, begin: float, end: float) -> None:
    for stamp in np.arange(begin, end, 0.004):
        estimator.offer_imu(imu(stamp, attitude=DRONE_IMU))
        estimator.offer_odometry(odometry(stamp))


DRONE_IMU = Rotation.from_matrix(DRONE.imu.rotation).as_quat()


def test_an_old_odometry_is_brought_forward_with_the_imu_s_rate(estimator: FlightEstimator) -> None:
    turned = Rotation.from_rotvec([0.0, 0.0, 0.3])
    speed, rate = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 2.0])
    estimator.offer_odometry(
        odometry(1.0, attitude=turned.as_quat(), velocity=speed, rate=rate - 0.5)
    )
    estimator.offer_imu(imu(1.02, rate))
    state = estimator.state()
    np.testing.assert_allclose(state.position, 0.02 * turned.apply(speed), atol=1e-12)
    np.testing.assert_allclose(state.velocity, turned.apply(speed), atol=1e-12)
    expected = (turned * Rotation.from_rotvec([0.0, 0.0, 0.04])).as_matrix()
    np.testing.assert_allclose(state.rotation, expected, atol=1e-6)
    np.testing.assert_allclose(state.rate, rate, atol=1e-5)


def test_silent_odometry_leaves_the_attitude(estimator: FlightEstimator) -> None:
    feed(estimator, 0.0, 0.5)
    tilted = Rotation.from_rotvec([0.2, 0.0, 0.0])
    attitude = (tilted * Rotation.from_matrix(DRONE.imu.rotation)).as_quat()
    for stamp in np.arange(0.5, 0.5 + 1.5 * SILENCE, 0.004):
        estimator.offer_imu(imu(stamp, attitude=attitude))
    assert estimator.state() is None
    assert estimator.missing() == ['odometry']
    alone = estimator.attitude_alone()
    np.testing.assert_allclose(alone.rotation, tilted.as_matrix(), atol=1e-9)
    estimator.offer_odometry(odometry(0.7))
    assert estimator.state() is not None


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'position': np.array([0.0, np.nan, 0.0])}, 'NaN or infinite'),
        ({'velocity': np.array([np.inf, 0.0, 0.0])}, 'NaN or infinite'),
        ({'attitude': np.zeros(4)}, 'length 0 instead of 1'),
        ({'velocity': np.array([300.0, 0.0, 0.0])}, 'velocity is above 100 m/s'),
        ({'rate': np.array([0.0, 90.0, 0.0])}, 'angular velocity is above 40 rad/s'),
        ({'position': np.array([2.0, 0.0, 0.0])}, r'position jumps by 2\.00 m'),
        ({'attitude': np.array([0.0, 0.0, 0.5, np.sqrt(0.75)])}, r'attitude jumps by 1\.05 rad'),
        ({'velocity': np.array([0.0, 0.0, -8.0])}, r'velocity jumps by 8\.00 m/s'),
        ({'rate': np.array([9.0, 0.0, 0.0])}, r'angular velocity jumps by 9\.00 rad/s'),
    ],
)
def test_an_unusable_odometry_is_refused_and_the_state_stays(
    estimator: FlightEstimator, changes: dict[str, object], message: str
) -> None:
    feed(estimator, 0.0, 0.5)
    with pytest.raises(RejectedInputError, match=message):
        estimator.offer_odometry(odometry(0.5, **changes))
    estimator.offer_odometry(odometry(0.504))
    np.testing.assert_allclose(estimator.state().position, 0.0, atol=1e-12)


def test_a_persistent_jump_is_accepted(estimator: FlightEstimator) -> None:
    feed(estimator, 0.0, 0.5)
    place, believed = np.array([3.0, -1.0, 0.0]), []
    for stamp in np.arange(0.5, 1.2, 0.004):
        estimator.offer_imu(imu(stamp, attitude=DRONE_IMU))
        with suppress(RejectedInputError):
            estimator.offer_odometry(odometry(stamp, position=place))
            believed.append(stamp)
    assert 0.75 < believed[0] < 0.85
    np.testing.assert_allclose(estimator.state().position, place)
    assert estimator.jumps == 1


def test_frozen_sensors_are_distinguished_from_a_drone_at_rest(estimator: FlightEstimator) -> None:
    feed(estimator, 0.0, 1.0)  # nothing moves: repetition proves nothing
    turning, stuck = np.array([0.0, 0.0, 0.4]), imu(0.0)
    with pytest.raises(RejectedInputError, match='odometry: repeated pose'):
        for stamp in np.arange(1.0, 1.3, 0.004):
            estimator.offer_imu(imu(stamp, turning))
            estimator.offer_odometry(odometry(stamp))
    with pytest.raises(RejectedInputError, match='IMU: repeated samples'):
        for stamp in np.arange(2.0, 2.3, 0.004):
            turn = Rotation.from_rotvec(stamp * turning).as_quat()
            estimator.offer_odometry(odometry(stamp, attitude=turn, rate=turning))
            estimator.offer_imu(replace(stuck, stamp=stamp))


def test_an_old_imu_or_one_that_contradicts_the_odometry_is_named(
    estimator: FlightEstimator,
) -> None:
    feed(estimator, 0.0, 0.1)
    for sample, reason in (
        (imu(0.1, np.array([5.0, 0.0, 0.0])), 'differs from that of the odometry'),
        (imu(0.05), 'IMU: a sample is not newer'),
    ):
        with pytest.raises(RejectedInputError, match=reason):
            estimator.offer_imu(sample)
    with pytest.raises(RejectedInputError, match='odometry: a sample is not newer'):
        estimator.offer_odometry(odometry(0.05))
    np.testing.assert_allclose(estimator.state().rate, 0.0, atol=1e-6)
