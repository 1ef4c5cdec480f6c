"""Derivatives of poses and residuals, compared with differences."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import MarkerSource, PoseSource, Source
from aerarm_ros.description.robot import load_robot

STEP = 1e-6
M = 5


@pytest.fixture(scope='module')
def geometry() -> ArmGeometry:
    return ArmGeometry(load_robot(), 'tool0')


@pytest.fixture(scope='module')
def errors(geometry: ArmGeometry) -> np.ndarray:
    return geometry.typical * np.random.default_rng(1).normal(size=len(geometry.names))


@pytest.fixture(scope='module')
def q(geometry: ArmGeometry) -> np.ndarray:
    low, high = geometry.robot.posture_range
    return np.random.default_rng(2).uniform(low, high, (M, geometry.robot.n))


def _sources() -> list[tuple[Source, np.ndarray]]:
    generator = np.random.default_rng(3)
    turn = Rotation.random(2, rng=generator).as_matrix()
    base = [turn[0].ravel(), generator.normal(size=3)]
    markers = MarkerSource('mocap', ('a', 'b'), generator.normal(size=(M, 2, 3)))
    marker_state = np.concatenate([*base, generator.normal(size=6) * 0.1])
    pose_state = np.concatenate([*base, turn[1].ravel(), generator.normal(size=3) * 0.1])
    rotation = Rotation.random(M, rng=generator).as_matrix()
    pose = PoseSource('body', rotation, generator.normal(size=(M, 3)))
    camera = replace(pose, name='camera', eye_in_hand=True)
    return [(markers, marker_state), (pose, pose_state), (camera, pose_state)]


def test_poses_follow_the_kinematic_regressor(
    geometry: ArmGeometry, errors: np.ndarray, q: np.ndarray
) -> None:
    poses = geometry.poses(q, errors)
    for column in range(len(errors)):
        step = np.zeros_like(errors)
        step[column] = STEP
        ahead, behind = geometry.poses(q, errors + step), geometry.poses(q, errors - step)
        linear = (ahead.position - behind.position) / (2 * STEP)
        turn = Rotation.from_matrix(ahead.rotation @ np.swapaxes(behind.rotation, 1, 2))
        angular = turn.as_rotvec() / (2 * STEP)
        np.testing.assert_allclose(poses.jacobian[:, :3, column], linear, atol=1e-7)
        np.testing.assert_allclose(poses.jacobian[:, 3:, column], angular, atol=1e-7)


@pytest.mark.parametrize('case', range(3))
def test_residuals_have_the_derivatives_that_sources_state(
    geometry: ArmGeometry, errors: np.ndarray, q: np.ndarray, case: int
) -> None:
    source, state = _sources()[case]
    poses = geometry.poses(q, errors)
    if isinstance(source, PoseSource):  # exact where nothing is left
        source = _measured_as_predicted(source, poses, state)
    by_errors, by_unknowns = source.jacobians(poses, state)
    assert by_unknowns.shape[2] == len(source.unknowns)
    assert by_errors.shape[1] == len(source.channels)
    for column in range(len(source.unknowns)):
        step = np.zeros(len(source.unknowns))
        step[column] = STEP
        ahead = source.residuals(poses, source.moved(state, step))
        behind = source.residuals(poses, source.moved(state, -step))
        difference = (ahead - behind) / (2 * STEP)
        np.testing.assert_allclose(by_unknowns[:, :, column], difference, atol=2e-7)
    for column in range(len(errors)):
        step = np.zeros_like(errors)
        step[column] = STEP
        ahead = source.residuals(geometry.poses(q, errors + step), state)
        behind = source.residuals(geometry.poses(q, errors - step), state)
        difference = (ahead - behind) / (2 * STEP)
        np.testing.assert_allclose(by_errors[:, :, column], difference, atol=2e-7)


def _measured_as_predicted(source: PoseSource, poses: object, state: np.ndarray) -> PoseSource:
    rotation, position = source._predicted(poses, state)  # type: ignore[arg-type]
    return replace(source, rotation=rotation, position=position)
