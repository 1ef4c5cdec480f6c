"""What the simulated arm is made of, as the parameters of an emulated arm have it."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport, mount_on_base
from aerarm_ros.ros.emulation.emulation_parameters import plant_parameters
from aerarm_ros.simulation.backlash_plant import BacklashPlant
from aerarm_ros.simulation.base_profile import BASE_PROFILES

CONFIG, ROBOT = load_arm_config(), load_robot()
SMOOTH = (0.0, 0.05)  # no Stribeck friction


def test_gears_have_the_requested_backlash() -> None:
    parameters = plant_parameters(CONFIG, ROBOT, 1, [0.02], 1e-3, SMOOTH, [])
    transport = make_emulated_transport(CONFIG, ROBOT, parameters=parameters)
    assert isinstance(transport.plant, BacklashPlant)
    np.testing.assert_array_equal(transport.plant.backlash, np.full(4, 0.02))
    assert transport.plant.true_parameters()['backlash'] == [0.02] * 4
    with pytest.raises(ValueError, match='only for an arm on a fixed base'):
        mount_on_base(transport, ROBOT, next(iter(BASE_PROFILES.values())))


def test_gears_have_no_backlash_by_default() -> None:
    assert plant_parameters(CONFIG, ROBOT, 1, [], 0.0, SMOOTH, []).backlash is None


def test_some_joints_alone_are_refused() -> None:
    with pytest.raises(ValueError, match='values: set one value, or one for each of the 4 joints'):
        plant_parameters(CONFIG, ROBOT, 1, [0.02, 0.01], 0.0, SMOOTH, [])


def test_play_that_is_not_there_cannot_wear() -> None:
    with pytest.raises(ValueError, match='set backlash'):
        plant_parameters(CONFIG, ROBOT, 1, [], 1e-3, SMOOTH, [])


def test_stribeck_friction_is_that_of_the_parameters() -> None:
    parameters = plant_parameters(CONFIG, ROBOT, 1, [], 0.0, (0.5, 0.03), [])
    assert (parameters.stribeck, parameters.stribeck_velocity) == (0.5, 0.03)
    assert parameters.as_dict()['stribeck'] == 0.5
