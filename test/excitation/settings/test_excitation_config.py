"""The packaged file, and values out of range."""

from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.settings import ExcitationConfig, load_excitation_config


def test_packaged_file_centres_joint_2_upright(config: ExcitationConfig, robot: Robot) -> None:
    assert config.bias_of(robot)[1] == pytest.approx(np.pi / 2, abs=1e-4)


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
        ('stop_time: 0.5', 'stop_time is obsolete.*: delete the line'),
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
