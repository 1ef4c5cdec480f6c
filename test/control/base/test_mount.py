from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import Mount
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


def test_the_link_may_be_named_without_the_prefix(robot) -> None:
    text = robot.urdf_text.replace('</robot>', IMU_LINK)
    for name in ('imu_link', 'left_imu_link'):
        mount = Mount.from_robot(load_robot(text, prefix='left_'), name)
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


def test_rotation_accelerates_the_base_more_than_the_imu() -> None:
    rate, spin = np.array([0.4, -1.1, 0.7]), np.array([-3.0, 2.0, 5.0])
    mount = Mount(np.eye(3), np.array([0.03, -0.02, 0.11]))
    lever = -mount.imu_position_in_base
    expected = np.cross(spin, lever) + np.cross(rate, np.cross(rate, lever))
    np.testing.assert_allclose(mount.acceleration_of_base(rate, spin), expected, atol=1e-12)
