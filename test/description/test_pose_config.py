import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.description.drone_config import PoseConfig


@pytest.mark.parametrize('rpy', [(0.0, 0.0, 0.0), (np.pi, 0.0, 0.5), (0.3, -1.2, 2.5)])
def test_angles_are_those_of_a_urdf(rpy: tuple[float, float, float]) -> None:
    expected = Rotation.from_euler('xyz', rpy).as_matrix()  # about the fixed axes, in this order
    np.testing.assert_allclose(PoseConfig((0.0, 0.0, 0.0), rpy).rotation, expected, atol=1e-12)
