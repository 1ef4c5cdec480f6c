"""Limits of the configuration, and values out of range."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.settings import (
    ExcitationConfig,
    ExcitationError,
    MotionLimits,
    load_excitation_config,
)


def test_without_bias_the_middle_of_the_range_is_taken(robot: Robot) -> None:
    middle = ExcitationConfig().bias_of(robot)
    np.testing.assert_allclose(middle, 0.5 * (robot.position_min + robot.position_max))
    with pytest.raises(ConfigError, match='bias has 2 values'):
        ExcitationConfig(bias=(0.0, 0.0)).bias_of(robot)
    with pytest.raises(ConfigError, match='bias of joint3 must be a finite number'):
        ExcitationConfig(bias=(0.0, 0.0, float('nan'), 0.0)).bias_of(robot)


@pytest.mark.parametrize(
    ('line', 'message'),
    [
        ('velocity_share: 1.5', 'velocity_share'),
        ('ground_clearance: -0.1', 'ground_clearance'),
        ('ramp_time: 0', 'ramp_time'),
        ('highest_frequency: 600', 'highest_frequency'),
        ('speed: 3', 'unknown key speed'),
        ('unchecked_pairs: a to b', "list of 'one to other'"),
        ('unchecked_pairs: [3]', "list of 'one to other'"),
    ],
)
def test_errors_name_file_and_key(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / 'excitation.yaml'
    path.write_text(line)
    with pytest.raises(ConfigError, match=message) as caught:
        load_excitation_config(path)
    assert str(caught.value).startswith(str(path))


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
