"""Conversion between the axes of ROS and PX4."""

import numpy as np
import pytest

from aerarm_ros.autopilot.px4 import frd_rotation, heading, ned
from aerarm_ros.control.base.base_motion import (
    attitude_ned_frd_to_enu_flu,
    quaternion,
    rotation_matrix,
)


def test_north_is_y_and_down_is_against_z() -> None:
    np.testing.assert_array_equal(ned([1.0, 2.0, 3.0]), [2.0, 1.0, -3.0])
    np.testing.assert_array_equal(ned(ned([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0])


def test_an_attitude_is_what_its_quaternion_says() -> None:
    turn = np.array([0.1, -0.4, 0.3, 0.85])
    in_ned = rotation_matrix(turn / np.linalg.norm(turn))
    in_enu = rotation_matrix(attitude_ned_frd_to_enu_flu(quaternion(in_ned)))
    np.testing.assert_allclose(frd_rotation(in_ned), in_enu, atol=1e-12)
    np.testing.assert_allclose(frd_rotation(in_enu), in_ned, atol=1e-12)


@pytest.mark.parametrize(('yaw', 'expected'), [(0.0, 90.0), (90.0, 0.0), (45.0, 45.0)])
def test_a_heading_is_counted_from_north_to_the_right(yaw: float, expected: float) -> None:
    assert np.degrees(heading(np.radians(yaw))) == pytest.approx(expected)
