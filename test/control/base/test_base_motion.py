from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import (
    ImuSample,
    Mount,
    attitude_ned_frd_to_enu_flu,
    frd_to_flu,
    rotation_matrix,
)
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import PoseConfig, load_drone_config
from aerarm_ros.description.robot import load_robot

IMU_LINK = """
  <joint name="imu_fixed" type="fixed">
    <parent link="base_link"/><child link="imu_link"/>
    <origin xyz="0.02 0 -0.1" rpy="3.14159265358979 0 0.5"/>
  </joint>
  <link name="imu_link"/>
</robot>"""


def test_reads_the_urdf(robot) -> None:
    drone = load_robot(robot.urdf_text.replace('</robot>', IMU_LINK))
    mount = Mount.from_robot(drone, 'imu_link')
    expected = Rotation.from_euler('xyz', [np.pi, 0.0, 0.5]).as_matrix()
    np.testing.assert_allclose(mount.rotation_imu_to_base, expected, atol=1e-9)
    np.testing.assert_allclose(mount.imu_position_in_base, [0.02, 0.0, -0.1])


@pytest.mark.parametrize(('link', 'message'), [('imu', 'is not in the URDF'), ('link2', 'moves')])
def test_a_link_that_cannot_hold_the_imu_is_refused(robot, link, message) -> None:
    with pytest.raises(ValueError, match=message):
        Mount.from_robot(robot, link)


def test_sees_the_drones_imu_from_the_arms_base() -> None:
    drone = replace(
        load_drone_config(),
        mount=PoseConfig((0.02, 0.0, -0.08), (np.pi, 0.0, 0.3)),
        imu=PoseConfig((0.03, -0.01, 0.05), (0.1, 0.2, 0.4)),
    )
    mount = Mount.from_drone(drone)
    base = Rotation.from_euler('xyz', drone.mount.rpy)
    imu = Rotation.from_euler('xyz', drone.imu.rpy)
    np.testing.assert_allclose(
        mount.rotation_imu_to_base, (base.inv() * imu).as_matrix(), atol=1e-12
    )
    # Back in the body frame it is where the file says.
    place = base.apply(mount.imu_position_in_base) + drone.mount.position
    np.testing.assert_allclose(place, drone.imu.position, atol=1e-12)


GOOD = {
    'stamp': 1.0,
    'attitude': np.array([0.0, 0.0, 0.0, 1.0]),
    'angular_velocity': np.zeros(3),
    'specific_force': np.array([0.0, 0.0, 9.81]),
}


def test_the_attitude_is_normalised() -> None:
    sample = ImuSample(**{**GOOD, 'attitude': np.array([0.0, 0.0, 0.0, 1.02])})
    np.testing.assert_allclose(sample.attitude, [0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'attitude': np.zeros(4)}, 'if the IMU has no attitude'),
        ({'attitude': np.array([0.0, 0.0, np.nan, 1.0])}, 'NaN'),
        ({'angular_velocity': np.array([np.nan, 0.0, 0.0])}, 'NaN'),
        ({'specific_force': np.array([0.0, np.inf, 0.0])}, 'NaN or infinite'),
        ({'specific_force': np.array([0.0, 0.0, 981.0])}, 'unit'),
        ({'angular_velocity': np.array([0.0, 0.0, 90.0])}, 'unit'),
    ],
)
def test_a_wrong_sample_is_rejected(changes, message) -> None:
    with pytest.raises(RejectedInputError, match=message):
        ImuSample(**{**GOOD, **changes})


def ned_to_enu(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([y, x, -z])


def test_a_vector_means_the_same_in_both_conventions() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        attitude = Rotation.random(random_state=random)
        in_frd = random.normal(size=3)
        converted = rotation_matrix(attitude_ned_frd_to_enu_flu(attitude.as_quat()))
        np.testing.assert_allclose(
            converted @ frd_to_flu(in_frd), ned_to_enu(attitude.apply(in_frd)), atol=1e-12
        )
