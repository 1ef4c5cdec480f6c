"""The packaged URDF: inertia of thesis table A.1, and contacts only by design."""

from itertools import product

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.clearance import ClearanceChecker


@pytest.fixture(scope='module')
def robot() -> Robot:
    return load_robot()


def test_inertia_is_the_cad_column(robot: Robot, table_a1: dict[str, np.ndarray]) -> None:
    cad = table_a1['CAD'][:40].reshape(4, 10)
    assert np.allclose(robot.inertial_parameters, cad, rtol=1e-12, atol=1e-17)


def test_links_touch_beyond_the_limits_only(robot: Robot) -> None:
    shapes = ClearanceChecker(robot, self_clearance=0.0)
    corners = product(*zip(robot.position_min, robot.position_max, strict=True))
    inside = np.random.default_rng(7).uniform(robot.position_min, robot.position_max, (500, 4))
    for q in [*map(np.array, corners), *inside, np.zeros(4)]:
        assert shapes.margin(q) > 0.0
    assert shapes.margin(np.array([0.0, -np.pi / 2, 0.0, 0.0])) < 0.0  # the arm in its base
