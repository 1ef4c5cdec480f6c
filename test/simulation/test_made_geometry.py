"""Arms with manufacturing deviations, and the sensors that measure them."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantParameters
from aerarm_ros.simulation.made_geometry import MadeGeometry
from aerarm_ros.simulation.mocap import MARKERS, EmulatedCamera, EmulatedMocap

ROBOT, CONFIG = load_robot(), load_arm_config()
LINK = ROBOT.link_names[-1]


def plant_of(made: MadeGeometry) -> ArmPlant:
    return ArmPlant(made.robot, PlantParameters.nominal(CONFIG, made.robot))


def test_deviations_have_the_sizes_that_the_spread_states() -> None:
    made = [MadeGeometry.of(ROBOT, seed) for seed in range(40)]
    offsets = np.array([one.offsets for one in made])
    assert np.std(offsets) == pytest.approx(0.010, rel=0.2)
    drawn = np.array([p.translation for p in ROBOT.model.jointPlacements][1:])
    shifts = [
        np.array([p.translation for p in one.robot.model.jointPlacements][1:]) - drawn
        for one in made
    ]
    assert np.std(shifts) == pytest.approx(1e-3, rel=0.15)
    assert MadeGeometry.of(ROBOT, 3).offsets.tolist() == made[3].offsets.tolist()


def test_the_engine_puts_links_where_the_displaced_urdf_has_them() -> None:
    made = MadeGeometry.of(ROBOT, 2)
    plant, q = plant_of(made), np.array([0.4, 1.1, -0.7, 0.9])
    plant.reset(q)
    rotation, place = plant.link_pose(LINK)
    data = made.robot.model.createData()
    pin.forwardKinematics(made.robot.model, data, q)
    np.testing.assert_allclose(place, data.oMi[4].translation, atol=1e-9)
    np.testing.assert_allclose(rotation, data.oMi[4].rotation, atol=1e-9)


def test_configuration_and_drone_are_as_made() -> None:
    made = MadeGeometry.of(ROBOT, 2)
    change = made.config(CONFIG).column('offset') - CONFIG.column('offset')
    np.testing.assert_allclose(change, made.offsets)
    drawn, drone = load_drone_config(), made.drone(load_drone_config())
    turn = Rotation.from_matrix(drone.mount.rotation @ drawn.mount.rotation.T).magnitude()
    assert turn == pytest.approx(np.linalg.norm(made.mount_turn), rel=1e-6)


def test_the_motion_capture_has_its_noise_and_hides_markers() -> None:
    plant = plant_of(MadeGeometry.of(ROBOT, 1))
    mocap = EmulatedMocap(LINK, 1, noise=0.2e-3, dropout=0.1)
    low, high = ROBOT.posture_range
    hidden, errors = [], []
    for q in np.random.default_rng(0).uniform(low, high, (150, 4)):
        plant.reset(q)
        frame, truth = mocap.read(plant), mocap.true_positions(plant)
        assert frame.shape == (len(MARKERS), 3)
        hidden.append(np.isnan(frame[:, 0]))
        errors.append((frame - truth)[np.isfinite(frame)])
    assert 0.1 < np.mean(hidden) < 0.5
    assert np.std(np.concatenate(errors)) == pytest.approx(0.2e-3, rel=0.1)


@pytest.mark.parametrize('eye_in_hand', [False, True])
def test_a_camera_is_least_certain_along_its_view(eye_in_hand: bool) -> None:
    plant = plant_of(MadeGeometry.of(ROBOT, 1))
    camera = EmulatedCamera(LINK, 1, eye_in_hand=eye_in_hand)
    low, high = ROBOT.posture_range
    errors = []
    for q in np.random.default_rng(0).uniform(low, high, (400, 4)):
        plant.reset(q)
        seen = camera.read(plant)
        if seen is not None:
            rotation, place = camera.true_pose(plant)
            turn = Rotation.from_matrix(seen[0].T @ rotation).magnitude()
            error, view = seen[1] - place, place / np.linalg.norm(place)
            errors.append([np.linalg.norm(np.cross(error, view)), error @ view, turn])
    across, along, turn = np.sqrt(np.mean(np.square(errors), axis=0))
    assert 20 < len(errors) < 390
    assert along > 3.0 * across
    assert 3e-5 < across < 2e-3 and 1e-3 < turn < 0.1
