"""Gears with backlash, in the physics engine."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.simulation.arm_plant import ArmPlant, PlantError, PlantParameters
from aerarm_ros.simulation.backlash_plant import BacklashPlant

ROBOT = load_robot()
NOMINAL = PlantParameters.nominal(load_arm_config(), ROBOT)
PLAY = np.array([0.01, 0.02, 0.012, 0.008])


def test_without_play_worth_the_name_it_is_the_arm_without() -> None:
    start = [0.0, 1.2, 0.3, -0.4]
    tight = BacklashPlant(ROBOT, replace(NOMINAL, backlash=np.full(4, 1e-9)), start)
    rigid = ArmPlant(ROBOT, NOMINAL, start)
    for cycle in range(400):
        effort = np.array([0.5, -1.5, 0.3, 0.1]) * np.sin(4.0 * np.pi * 1e-3 * cycle)
        for plant in (tight, rigid):
            plant.apply_effort(effort)
            plant.advance(1e-3)
    assert tight.position == pytest.approx(rigid.position, abs=1e-3)
    assert tight.transmitted_effort == pytest.approx(rigid.transmitted_effort, abs=0.02)


def test_gravity_presses_each_gear_onto_a_flank() -> None:
    leaning = np.array([0.0, 0.5 * np.pi + 0.3, 0.2, 0.1])
    plant = BacklashPlant(ROBOT, replace(NOMINAL, backlash=PLAY), leaning)
    plant.apply_effort([0.0, -1.0, 0.0, 0.0])
    plant.advance(0.2)
    ahead = plant.link_position - plant.position
    assert np.abs(ahead[1:]) == pytest.approx(0.5 * PLAY[1:], rel=0.05)
    assert (np.abs(ahead) < 0.51 * PLAY).all()


def test_play_that_cannot_be_is_refused() -> None:
    with pytest.raises(PlantError, match='must be above 0 rad, one for each of joint1'):
        BacklashPlant(ROBOT, replace(NOMINAL, backlash=np.array([0.01, 0.0, 0.01, 0.01])))
