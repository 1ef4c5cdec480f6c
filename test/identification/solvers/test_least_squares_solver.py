"""Least squares recovers base parameters exactly from noise-free data."""

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.regression.base_parameters import find_base_parameters
from aerarm_ros.identification.regression.regression import ReducedRegression, triangular_factor
from aerarm_ros.identification.solvers.least_squares_solver import solve_least_squares
from aerarm_ros.model.regressor import Regressor


@pytest.mark.parametrize('weights', [1.0, [1.0, 0.2, 5.0, 30.0]])
def test_exact_recovery(robot: Robot, weights) -> None:
    random = np.random.default_rng(0)
    regressor = Regressor(robot, rotor_inertia=True)
    stacked = regressor.stack(*random.uniform(-2.0, 2.0, (3, 100, robot.n)))
    true, reference = random.uniform(-1.0, 1.0, (2, stacked.shape[1]))
    rows = np.column_stack([stacked, stacked @ true]).reshape(100, robot.n, -1)
    factors = [triangular_factor(rows[:, joint]) for joint in range(robot.n)]
    regression = ReducedRegression(regressor.columns, factors, [100] * robot.n)
    found = solve_least_squares(regression, reference, weights)
    base = find_base_parameters(regression.system().R, regression.columns)
    assert np.allclose(base.values(found), base.values(true), atol=1e-8)
    assert np.array_equal(found[base.dependent], reference[base.dependent])
    assert regression.error(found) < 1e-8
