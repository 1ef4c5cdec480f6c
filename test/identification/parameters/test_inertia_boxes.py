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
    boxes = inertia_boxes(from_pseudo_inertia(matter)[None])
    assert boxes.centre[0] == pytest.approx(centre)
    assert boxes.half_edges[0] == pytest.approx(half)
    assert boxes.reach[0] == pytest.approx(half)
    corners = boxes.corners()[0]
    assert corners.max(axis=0) == pytest.approx(centre + half)
    assert corners.min(axis=0) == pytest.approx(centre - half)


def test_an_impossible_inertia_has_no_box(robot: Robot) -> None:
    wrong = np.array(robot.inertial_parameters)
    wrong[1, 4:] = 0.0
    boxes = inertia_boxes(wrong)
    assert list(np.isnan(boxes.half_edges).any(axis=1)) == [False, True, False, False]
