"""The URDF of drone and arm: the drone's numbers, the arm's kinematics, one tree."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.drone_config import PoseConfig, load_drone_config
from aerarm_ros.description.drone_urdf import with_drone
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.description.urdf_document import UrdfDocument

Q = np.array([0.4, 1.1, -0.3, 0.7])
ARM = load_robot()
DRONE = replace(
    load_drone_config(resource('config', 'drones', 'tilted_hexarotor.yaml')),
    centre_of_mass=(0.02, -0.01, 0.015),
    inertia=(0.045, 0.05, 0.08, 0.002, -0.003, 0.001),
    mount=PoseConfig((0.03, 0.01, -0.07), (2.9, 0.2, 0.4)),
)
TEXT = with_drone(ARM.urdf_text, DRONE)


def test_mass_properties_are_those_of_both() -> None:
    model = pin.buildModelFromXML(TEXT, pin.JointModelFreeFlyer())
    data = model.createData()
    pin.crba(model, data, np.concatenate([pin.neutral(model)[:7], Q]))
    alone = load_robot().model
    alone_data = alone.createData()
    pin.forwardKinematics(alone, alone_data, Q)
    mount = pin.SE3(DRONE.mount.rotation, np.array(DRONE.mount.position))
    expected = pin.Inertia(DRONE.mass, np.array(DRONE.centre_of_mass), DRONE.inertia_matrix)
    for placement, inertia in zip(alone_data.oMi, alone.inertias, strict=True):
        if inertia.mass > 0.0:
            expected += mount.act(placement.act(inertia))
    whole = data.Ycrb[1]
    assert whole.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(whole.lever, expected.lever, atol=1e-9)
    np.testing.assert_allclose(whole.inertia, expected.inertia, atol=1e-9)


def test_the_arm_moves_below_its_mount_as_ever() -> None:
    both, alone = load_robot(TEXT), ARM
    assert both.joint_names == alone.joint_names
    places = []
    for robot in (both, alone):
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, Q)
        frame = robot.model.getFrameId('tool0')
        places.append(pin.updateFramePlacement(robot.model, data, frame).copy())
    mount = pin.SE3(DRONE.mount.rotation, np.array(DRONE.mount.position))
    expected = mount * places[1]
    np.testing.assert_allclose(places[0].homogeneous, expected.homogeneous, atol=1e-12)
    assert UrdfDocument(TEXT).joints['drone_mount'].parent == 'drone'
    place = both.model.frames[both.model.getFrameId('drone_imu')].placement
    np.testing.assert_allclose(place.translation, DRONE.imu.position)


def test_a_second_drone_is_refused() -> None:
    with pytest.raises(DescriptionError, match='has a link drone'):
        with_drone(TEXT.replace('drone_imu', 'other'), DRONE)


def test_a_prefix_distinguishes_two_drones() -> None:
    arm = load_robot(prefix='left_')
    both, other = UrdfDocument(with_drone(arm.urdf_text, DRONE, 'left_')), UrdfDocument(TEXT)
    assert both.links == {f'left_{name}' for name in other.links}
    assert set(both.joints) == {f'left_{name}' for name in other.joints}
