"""Limits from the configuration and the URDF, and their used fraction."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.settings import ExcitationError, MotionLimits


def test_arm_and_urdf_agree(arm: ArmConfig, robot: Robot) -> None:
    ours, urdf = MotionLimits.of_arm(arm), MotionLimits.of_robot(robot)
    assert ours.joint_names == urdf.joint_names
    for field in ('position_min', 'position_max', 'velocity', 'effort'):
        np.testing.assert_allclose(getattr(ours, field), getattr(urdf, field), rtol=1e-3)
    assert np.isinf(urdf.current).all()


def test_usable_fractions_narrow_every_limit_about_the_middle(arm: ArmConfig) -> None:
    whole = MotionLimits.of_arm(arm)
    part = whole.scaled(0.9, 0.5, 0.8)
    np.testing.assert_allclose(
        part.position_min + part.position_max, whole.position_min + whole.position_max
    )
    np.testing.assert_allclose(
        part.position_max - part.position_min, 0.9 * (whole.position_max - whole.position_min)
    )
    np.testing.assert_allclose(part.acceleration, 0.5 * whole.acceleration)
    np.testing.assert_allclose(part.current, 0.8 * whole.current)


def test_contradictory_limits_name_the_joint() -> None:
    one = np.ones(2)
    with pytest.raises(ExcitationError, match='b leave no range'):
        MotionLimits(('a', 'b'), np.array([-1.0, 2.0]), one, one, one, one, one)
    with pytest.raises(ExcitationError, match='velocity of a must be positive'):
        MotionLimits(('a', 'b'), -one, one, np.array([0.0, 1.0]), one, one, one)
    with pytest.raises(ExcitationError, match='2 values'):
        MotionLimits(('a', 'b'), -one, one, np.ones(3), one, one, one)
