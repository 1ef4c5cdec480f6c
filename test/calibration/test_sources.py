"""Other sources than a motion capture: cameras, contacts, recordings in motion, postures."""

import numpy as np
import pytest
from measured_arm import CONFIG, LINK, ROBOT, MeasuredArm, own_chain

from aerarm_ros.calibration.calibrate import calibrate
from aerarm_ros.calibration.choice import LEVELS, identifiable
from aerarm_ros.calibration.files import calibrated_urdf
from aerarm_ros.calibration.fit import fitted, registered
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import (
    CalibrationError,
    MarkerSource,
    Observations,
    PoseSource,
)
from aerarm_ros.calibration.plateaus import Track, rest_observations, resting_arm, time_offset
from aerarm_ros.calibration.posture_choice import choose_postures, faces_camera
from aerarm_ros.description.robot import load_robot
from aerarm_ros.simulation.made_geometry import rotation_about
from aerarm_ros.simulation.mocap import EmulatedCamera


def camera_poses(arm: MeasuredArm, q: np.ndarray, eye_in_hand: bool) -> PoseSource:
    camera = EmulatedCamera(LINK, arm.seed, eye_in_hand=eye_in_hand)
    rotation, position = np.full((len(q), 3, 3), np.nan), np.full((len(q), 3), np.nan)
    for k, row in enumerate(q):
        arm.plant.reset(row + arm.made.offsets)
        pose = camera.read(arm.plant)
        if pose is not None:
            rotation[k], position[k] = pose
    return PoseSource('camera', rotation, position, eye_in_hand)


@pytest.mark.parametrize('eye_in_hand', [False, True])
def test_a_camera_calibrates_the_arm_as_well(eye_in_hand: bool) -> None:
    arm = MeasuredArm(6)
    q = arm.postures(200)
    source = camera_poses(arm, q, eye_in_hand)
    seen = np.flatnonzero(source.seen)
    assert 40 < len(seen) < len(q)
    observations = Observations(q, (source,)).rows(seen[:60])
    found = calibrate(own_chain(), observations, level='geometry', compliance=False)
    # By the motion capture's markers: the camera's own are nowhere near them.
    observations = arm.true_observations(arm.postures(30, seed=1))
    drawn = registered(ArmGeometry(ROBOT, LINK), observations)
    robot = load_robot(calibrated_urdf(found, with_offsets=True))
    after = registered(ArmGeometry(robot, LINK), observations)
    before, left = (found.errors(fit, observations)[0] for fit in (drawn, after))
    assert left < 0.25 * before
    assert left < 1.5e-3


def recording(late: float) -> tuple[np.ndarray, np.ndarray, Track, MeasuredArm, np.ndarray]:
    """Return joint states and a marker of an arm that rests in twelve postures."""
    arm = MeasuredArm(8)
    postures = arm.postures(12)
    time = np.arange(0.0, 12 * 2.5, 0.01)
    share = np.clip((time % 2.5) / 1.2, 0.0, 1.0)
    smooth = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    which = (time // 2.5).astype(int)
    before = postures[np.maximum(which - 1, 0)]
    q = before + smooth[:, None] * (postures[which] - before)
    place = arm.true_positions(q)[:, 0]
    place += 0.2e-3 * np.random.default_rng(2).normal(size=place.shape)
    return time, q, Track('marker1', time + late, place), arm, postures


@pytest.mark.parametrize('late', [0.0, 0.137, -2.31])
def test_rests_and_the_time_offset_are_found(late: float) -> None:
    time, q, track, arm, postures = recording(late)
    found, agreement = time_offset(time, q, track)
    assert found == pytest.approx(late, abs=0.02)
    assert agreement > 0.8
    rests = resting_arm(time, q)
    np.testing.assert_allclose(rests.q, postures, atol=1e-6)
    observations = rest_observations(rests, [track], {'marker1': found})
    source = observations.sources[0]
    assert isinstance(source, MarkerSource)
    true = arm.true_positions(postures)[:, 0]
    assert np.abs(source.position[:, 0] - true).max() < 0.15e-3


def test_an_arm_that_never_rests_is_one_error() -> None:
    time, q, track, *_ = recording(0.0)
    q = q + 0.3 * np.sin(3.0 * time)[:, None]
    with pytest.raises(CalibrationError, match='no rest period of 0.4 s: let the arm rest'):
        rest_observations(resting_arm(time, q), [track], {})


def test_chosen_postures_tell_more_than_random_ones() -> None:
    geometry = ArmGeometry(ROBOT, LINK)

    def is_allowed(q: np.ndarray) -> bool:
        return bool(q[1] > 0.5)

    choice = choose_postures(geometry, 12, is_allowed, start=np.array(CONFIG.rest_position))
    assert choice.q.shape == (12, ROBOT.n)
    assert (choice.q[:, 1] > 0.5).all()
    assert (choice.q > ROBOT.position_min).all() and (choice.q < ROBOT.position_max).all()
    assert choice.information > 0.2
    with pytest.raises(CalibrationError, match='are allowed: .* the camera position and'):
        choose_postures(geometry, 4, lambda q: False)
    worst = [deviations(geometry, q) for q in (choice.q, _random(12))]
    assert worst[0] < worst[1]


def _random(count: int) -> np.ndarray:
    low, high = ROBOT.posture_range
    return np.random.default_rng(3).uniform(low, high, (count, ROBOT.n))


def deviations(geometry: ArmGeometry, q: np.ndarray) -> float:
    """Return the geometric mean of the standard deviations in some postures."""
    arm = MeasuredArm(9, frames=3)
    start = registered(geometry, arm.observe(q))
    fit = fitted(start, identifiable(start, LEVELS['geometry']).columns)
    scaled = fit.deviations[: len(fit.free)] / geometry.typical[list(fit.free)] / fit.length
    return float(np.exp(np.mean(np.log(scaled))))


def test_an_independent_camera_sees_the_marker_in_every_chosen_posture() -> None:
    geometry, arm = ArmGeometry(ROBOT, LINK), MeasuredArm(6)
    normal = rotation_about(np.array([0.2, 1.3, -0.1])) @ np.array([0.0, 0.0, 1.0])
    is_visible = faces_camera(geometry, np.array([0.9, -0.9, 0.5]), normal)
    choice = choose_postures(geometry, 10, is_visible)
    assert camera_poses(arm, choice.q, False).seen.all()
    assert camera_poses(arm, _random(30), False).seen.sum() < 25
    with pytest.raises(CalibrationError, match='pass a vector of non-zero length'):
        faces_camera(geometry, np.ones(3), np.zeros(3))
