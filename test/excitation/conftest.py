"""The packaged arm and its checks, built once."""

import sys
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance import ClearanceChecker
from aerarm_ros.excitation.excitation_setup import ExcitationSetup, RandomTrajectory
from aerarm_ros.excitation.feasibility import FeasibilityChecker
from aerarm_ros.excitation.settings import ExcitationConfig, load_excitation_config
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.excitation.trajectory_designer import (
    DesignResult,
    DesignSpecification,
    TrajectoryDesigner,
)

# For boxed_arm.py and mujoco_arm.py; the benchmark uses the latter too.
sys.path.append(str(Path(__file__).parent))


@pytest.fixture(scope='session')
def arm() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='session')
def config() -> ExcitationConfig:
    return load_excitation_config()


@pytest.fixture(scope='session')
def setup(robot: Robot, arm: ArmConfig, config: ExcitationConfig) -> ExcitationSetup:
    return ExcitationSetup.of_arm(robot, arm, config)


@pytest.fixture(scope='session')
def clearance(setup: ExcitationSetup) -> ClearanceChecker:
    return setup.clearance


@pytest.fixture(scope='session')
def checker(setup: ExcitationSetup) -> FeasibilityChecker:
    return setup.checker


@pytest.fixture(scope='session')
def designer(setup: ExcitationSetup) -> TrajectoryDesigner:
    return TrajectoryDesigner(DesignSpecification(setup))


@pytest.fixture(scope='session')
def designed(designer: TrajectoryDesigner) -> DesignResult:
    return designer.design(0)


@pytest.fixture(scope='session')
def candidates(robot: Robot, config: ExcitationConfig) -> RandomTrajectory:
    return RandomTrajectory(config.bias_of(robot), config.bias_spread)


@pytest.fixture(scope='session')
def trajectory(candidates: RandomTrajectory) -> FourierTrajectory:
    return candidates.draw(np.random.default_rng(3))
