import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.mount import Mount
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


@pytest.mark.parametrize(('link', 'message'), [('imu', 'no link'), ('link2', 'moves')])
def test_a_link_that_cannot_hold_the_imu_is_refused(robot, link, message) -> None:
    with pytest.raises(ValueError, match=message):
        Mount.from_robot(robot, link)
