"""PX4's conventions at the edge; the node itself needs px4_msgs."""

from importlib.util import find_spec

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from aerarm_ros.nodes import px4_imu
from aerarm_ros.nodes.state_stream import to_imu_sample


def test_a_level_autopilot_at_rest() -> None:
    message = px4_imu.to_imu(Time(sec=3), [0.0, 0.0, 0.0, 1.0], [0.1, 0.2, 0.3], [0.0, 0.0, -9.81])
    sample = to_imu_sample(message)
    assert sample.stamp == 3.0
    np.testing.assert_allclose(sample.specific_force, [0.0, 0.0, 9.81])
    np.testing.assert_allclose(sample.angular_velocity, [0.1, -0.2, -0.3])
    # Nose to the north: a quarter turn from the east.
    np.testing.assert_allclose(np.abs(sample.attitude), [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])


def test_without_attitude_it_says_so() -> None:
    message = px4_imu.to_imu(Time(), None, [0.0, 0.0, 0.0], [0.0, 0.0, -9.81])
    assert to_imu_sample(message).attitude is None


@pytest.mark.skipif(find_spec('px4_msgs') is not None, reason='px4_msgs is installed')
def test_without_px4_msgs_it_says_what_to_do(ros_domain, capsys) -> None:
    assert px4_imu.main([]) == 1
    assert 'MAVROS' in capsys.readouterr().err
