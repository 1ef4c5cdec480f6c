"""Motions that say too little are refused or reported."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identify import excitation_warnings
from aerarm_ros.identification.regression.base_parameters import (
    BaseParameters,
    find_base_parameters,
)
from aerarm_ros.model.regressor import Regressor


def base_of(robot: Robot, moving: list[int]) -> BaseParameters:
    """Base parameters of a motion in which only some joints move."""
    states = np.zeros((3, 200, robot.n))
    states[:, :, moving] = np.random.default_rng(0).uniform(-2, 2, (3, 200, len(moving)))
    regressor = Regressor(robot)
    return find_base_parameters(np.linalg.qr(regressor.stack(*states))[1], regressor.columns)


def test_a_rich_motion_needs_no_comment(robot: Robot) -> None:
    assert excitation_warnings(base_of(robot, [0, 1, 2, 3]), Regressor(robot)) == []


def test_joints_at_rest_cost_parameters(robot: Robot) -> None:
    (text,) = excitation_warnings(base_of(robot, [0, 1, 3]), Regressor(robot))
    assert 'of 30 parameter combinations' in text


def test_condition_decides(robot: Robot) -> None:
    base = base_of(robot, [0, 1, 2, 3])
    (text,) = excitation_warnings(replace(base, condition_number=500.0), Regressor(robot))
    assert 'excites the parameters poorly' in text
    with pytest.raises(IdentificationError, match='too short or too small to excite'):
        excitation_warnings(replace(base, condition_number=5000.0), Regressor(robot))
    nothing = find_base_parameters(np.zeros((48, 48)), base.columns)
    with pytest.raises(IdentificationError, match='excites no parameter'):
        excitation_warnings(nothing, Regressor(robot))
