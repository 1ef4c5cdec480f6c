from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot


@pytest.fixture(scope='session')
def arm() -> Robot:
    return load_robot()


@pytest.fixture(scope='session', params=['aerarm', 'hanging aerarm', 'UR10', 'Panda'])
def robot(request: pytest.FixtureRequest, example_urdf: Callable[[str], Path]) -> Robot:
    if request.param == 'UR10':
        return load_robot(example_urdf('ur10_robot.urdf'))
    if request.param == 'Panda':
        fingers = ('panda_finger_joint1', 'panda_finger_joint2')
        return load_robot(example_urdf('panda.urdf'), locked=fingers)
    gravity = (1.0, -2.0, 9.5) if request.param == 'hanging aerarm' else (0.0, 0.0, -9.81)
    return load_robot(gravity_in_base=gravity)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20241107)
