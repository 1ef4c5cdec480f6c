"""What the simulated arm is made of, as the parameters of an emulated arm have it."""

from types import SimpleNamespace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport, mount_on_base
from aerarm_ros.ros.emulation.emulation_parameters import plant_parameters
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.backlash_plant import BacklashPlant
from aerarm_ros.simulation.base_profile import BASE_PROFILES

CONFIG, ROBOT = load_arm_config(), load_robot()


def made(backlash: list[float], stribeck: tuple[float, float] = (0.0, 0.05)) -> PlantParameters:
    """Return the parameters of an arm without payload, by default without Stribeck friction."""
    values = SimpleNamespace(seed=1, backlash=backlash)
    values.stribeck, values.stribeck_velocity = stribeck
    return plant_parameters(CONFIG, ROBOT, values, [])


def test_gears_have_the_requested_backlash() -> None:
    parameters = made([0.02])
    transport = make_emulated_transport(CONFIG, ROBOT, parameters=parameters)
    assert isinstance(transport.plant, BacklashPlant)
    np.testing.assert_array_equal(transport.plant.backlash, np.full(4, 0.02))
    assert transport.plant.true_parameters()['backlash'] == [0.02] * 4
    with pytest.raises(ValueError, match='only for an arm on a fixed base'):
        mount_on_base(transport, ROBOT, next(iter(BASE_PROFILES.values())))


def test_backlash_is_optional_and_not_for_some_joints_alone() -> None:
    assert made([]).backlash is None
    with pytest.raises(ValueError, match='one for each of the 4 joints'):
        made([0.02, 0.01])
