"""The packaged arm and its checks, built once."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig, load_arm_config
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.clearance_checker import ClearanceChecker
from aerarm_ros.excitation.effort_model import EffortModel
from aerarm_ros.excitation.excitation_config import ExcitationConfig, load_excitation_config
from aerarm_ros.excitation.feasibility_checker import FeasibilityChecker
from aerarm_ros.excitation.fourier_trajectory import FourierTrajectory
from aerarm_ros.excitation.motion_limits import MotionLimits
from aerarm_ros.excitation.random_trajectory import RandomTrajectory


@pytest.fixture(scope='session')
def arm() -> ArmConfig:
    return load_arm_config()


@pytest.fixture(scope='session')
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope='session')
def config() -> ExcitationConfig:
    return load_excitation_config()


@pytest.fixture(scope='session')
def clearance(robot: Robot, config: ExcitationConfig) -> ClearanceChecker:
    return ClearanceChecker(
        robot, config.self_clearance, config.ground_clearance, config.ground_height
    )


@pytest.fixture(scope='session')
def checker(
    robot: Robot, arm: ArmConfig, config: ExcitationConfig, clearance: ClearanceChecker
) -> FeasibilityChecker:
    limits = MotionLimits.of_arm(arm).scaled(
        config.position_share, config.velocity_share, config.effort_share
    )
    return FeasibilityChecker(limits, clearance, EffortModel.of_arm(robot, arm))


@pytest.fixture(scope='session')
def candidates(robot: Robot, config: ExcitationConfig) -> RandomTrajectory:
    return RandomTrajectory(config.bias_of(robot), config.bias_spread)


@pytest.fixture(scope='session')
def trajectory(candidates: RandomTrajectory) -> FourierTrajectory:
    return candidates.draw(np.random.default_rng(3))
