"""Poses of mount and IMU from recordings of a moving drone with noisy sensors."""

from pathlib import Path

import numpy as np
import pytest
from measured_arm import LINK, ROBOT
from moving_drone import MovingDrone, angle

from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.mount import calibrate_imu, calibrate_mount, drone_yaml
from aerarm_ros.calibration.observations import CalibrationError
from aerarm_ros.calibration.plateaus import Track
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.resources import resource


@pytest.fixture(scope='module')
def moving() -> MovingDrone:
    return MovingDrone(2)


@pytest.fixture(scope='module')
def body(moving: MovingDrone) -> Track:
    return moving.body()


@pytest.fixture(scope='module')
def markers(moving: MovingDrone) -> list[Track]:
    return moving.markers()


def test_the_mount_is_found_within_1_mm_and_2_mrad(
    moving: MovingDrone, body: Track, markers: list[Track]
) -> None:
    time, q = moving.joints(late=0.035)
    found = calibrate_mount(ArmGeometry(ROBOT, LINK), time, q, body, markers)
    mount = moving.drone.mount
    assert np.linalg.norm(found.pose.position - mount.position) < 1e-3
    assert angle(found.pose.rotation, mount.rotation) < 2e-3
    assert found.late == pytest.approx(0.035, abs=2e-3)


def test_the_imu_is_found_within_1_mm_and_2_mrad_in_a_tilted_world_and_written(
    tmp_path: Path,
) -> None:
    moving = MovingDrone(2, tilt=0.03)
    found = calibrate_imu(moving.body(), *moving.imu(late=-0.02))
    imu = moving.drone.imu
    assert np.linalg.norm(found.pose.position - imu.position) < 1e-3
    assert angle(found.pose.rotation, imu.rotation) < 2e-3
    assert found.late == pytest.approx(-0.02, abs=2e-3)
    off = np.abs(found.pose.position - imu.position)
    assert (off < 4.0 * found.pose.position_std + 1e-4).all()
    path = tmp_path / 'drone.yaml'
    path.write_text(drone_yaml(resource('config', 'drone.yaml'), None, found.pose))
    drone = load_drone_config(path)
    np.testing.assert_allclose(drone.imu.position, found.pose.position, atol=1e-6)
    np.testing.assert_allclose(drone.imu.rotation, found.pose.rotation, atol=1e-5)
    assert drone.mount == load_drone_config().mount


def test_an_arm_that_hardly_moves_shows_no_mount() -> None:
    moving = MovingDrone(1, duration=8.0)
    whole, moves = moving.q, np.array([False, True, False, False])
    moving.q = lambda t: np.where(moves, whole(t), whole(0.0))  # type: ignore[method-assign]
    time, q = moving.joints(late=0.0)
    q = q + 1e-4 * moving.random.normal(size=q.shape)
    with pytest.raises(CalibrationError, match='every joint( moves)? by more than 0.5 rad'):
        calibrate_mount(ArmGeometry(ROBOT, LINK), time, q, moving.body(), moving.markers())


def test_markers_10_mm_from_their_prediction_are_one_error(
    moving: MovingDrone, body: Track, markers: list[Track]
) -> None:
    time, q = moving.joints(late=0.0)
    generator = np.random.default_rng(1)
    spoilt = [
        Track(one.name, one.time, one.position + 0.012 * generator.normal(size=one.position.shape))
        for one in markers
    ]
    with pytest.raises(CalibrationError, match='from their predicted positions'):
        calibrate_mount(ArmGeometry(ROBOT, LINK), time, q, body, spoilt)


def test_a_drone_that_does_not_turn_shows_no_imu() -> None:
    moving = MovingDrone(1, turn=0.0, duration=5.0)
    with pytest.raises(CalibrationError, match='turn'):
        calibrate_imu(moving.body(), *moving.imu(late=0.0))
