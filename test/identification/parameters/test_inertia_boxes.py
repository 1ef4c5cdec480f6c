"""Boxes have the inertia that they stand for."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import inertia_boxes
from aerarm_ros.model.inertia import from_pseudo_inertia


def test_a_box_is_found_again() -> None:
    half, centre = np.array([0.02, 0.05, 0.3]), np.array([0.1, -0.2, 0.05])
    point = np.append(centre, 1.0)
    matter = 2.0 * (np.outer(point, point) + np.diag([*(half**2 / 3.0), 0.0]))
    found, reach = inertia_boxes(from_pseudo_inertia(matter)[None])
    assert found[0] == pytest.approx(centre)
    assert reach[0] == pytest.approx(half)


def test_an_impossible_inertia_has_no_box(robot: Robot) -> None:
    wrong = np.array(robot.inertial_parameters)
    wrong[1, 4:] = 0.0
    _, reach = inertia_boxes(wrong)
    assert list(np.isnan(reach).any(axis=1)) == [False, True, False, False]
