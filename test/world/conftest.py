"""The arm under a body, for the control law of the tool in the world."""

import pytest

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import Robot


@pytest.fixture(scope='session')
def limits() -> JointLimits:
    return JointLimits.from_config(load_arm_config())


@pytest.fixture
def carried(robot: Robot) -> MovingBaseDynamics:
    """Return the arm under a body of 2 kg at the base's origin."""
    carrier = [2.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.02, 0.0, 0.0, 0.03]
    return MovingBaseDynamics(robot, load_arm_config().column('reflected_inertia'), carrier)
