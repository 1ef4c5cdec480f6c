import sys
from pathlib import Path

import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.planner.motion_plan import PlanSettings
from aerarm_ros.planner.motion_planner import MotionPlanner

# For dense_check.py and what it needs.
sys.path += [str(Path(__file__).parents[1] / 'excitation'), str(Path(__file__).parent)]

from dense_check import DenseCheck  # noqa: E402


@pytest.fixture(scope='session')
def setup(robot: Robot) -> ExcitationSetup:
    return ExcitationSetup.of_arm(robot, load_arm_config(), load_excitation_config())


@pytest.fixture(scope='session')
def model(robot: Robot) -> EnergyModel:
    return EnergyModel(load_arm_config(), robot, load_friction=[0.04, 0.02, 0.04, 0.02])


@pytest.fixture(scope='session')
def planner(model: EnergyModel, setup: ExcitationSetup) -> MotionPlanner:
    """Return a planner of motions of two seconds."""
    return MotionPlanner(model, setup, PlanSettings(duration=2.0))


@pytest.fixture(scope='session')
def dense_check(robot: Robot, model: EnergyModel) -> DenseCheck:
    """Return a check of motions by another engine."""
    rotors, friction = model.dynamics.rotor_inertia, model.load_friction
    return DenseCheck(robot, load_arm_config(), load_excitation_config(), rotors, friction)
