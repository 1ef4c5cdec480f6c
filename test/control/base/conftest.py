"""A flying arm in the physics engine."""

from collections.abc import Callable

import pytest
from flying_arm import FlyingArm

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot


@pytest.fixture
def make_flying_arm(robot: Robot, config: ArmConfig) -> Callable[..., FlyingArm]:
    return lambda **mount: FlyingArm(robot, config.column('reflected_inertia'), **mount)
