from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import PowerStageConfig
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.energy.energy_model import DrivePower

TAU = np.array([2.0, -3.0, 1.0, 0.5])
DQ = np.array([1.0, 0.5, -2.0, 0.0])


def test_power_is_that_of_the_motors_by_current_and_speed(config) -> None:
    """Thesis (4.1), on the motor's side of the gear."""
    current = TAU / config.column('torque_per_ampere')
    speed = DQ / config.column('gear.ratio')
    copper = 1.5 * config.column('motor.resistance') * current**2
    expected = copper + config.column('motor.torque_constant') * current * speed
    np.testing.assert_allclose(DrivePower(config).electrical(TAU, DQ), expected)


def test_braking_power_comes_back_as_far_as_the_power_stage_lets_it(config) -> None:
    stage = PowerStageConfig(recovery=0.6)
    drives = DrivePower(replace(config, power_stage=stage))
    np.testing.assert_allclose(drives.from_supply([-2.0, 3.0]), [-1.2, 3.0])
    assert DrivePower(config).from_supply(-2.0) == 0.0


@pytest.mark.parametrize('wrong', [{'recovery': 1.1}, {'standby': -1.0}])
def test_a_power_stage_that_cannot_be_is_refused(wrong) -> None:
    with pytest.raises(ConfigError, match=f'power_stage: {next(iter(wrong))}'):
        PowerStageConfig(**wrong)
