"""Ranks known from the thesis, and bases that span the right space."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.criteria import IdentifiableSpace, SmoothRegressor
from aerarm_ros.excitation.trajectory import FourierTrajectory


def test_ranks_of_the_arm(robot: Robot) -> None:
    regressor = SmoothRegressor(robot)
    thesis = IdentifiableSpace.of_regressor(robot, regressor, regressor.thesis_columns)
    assert (thesis.rank, thesis.basis.shape) == (30, (48, 30))  # thesis 5.3
    assert IdentifiableSpace.of_regressor(robot, regressor, slice(None)).rank == 32


def test_gravity_across_joint_1_shows_two_more() -> None:
    tilted = load_robot(gravity_in_base=(3.0, 0.0, -9.3))
    regressor = SmoothRegressor(tilted)
    space = IdentifiableSpace.of_regressor(tilted, regressor, regressor.thesis_columns)
    assert space.rank == 32


def test_every_trajectory_lies_in_the_space(robot: Robot, trajectory: FourierTrajectory) -> None:
    regressor = SmoothRegressor(robot)
    space = IdentifiableSpace.of_regressor(robot, regressor, slice(None))
    stacked = regressor.stack(trajectory.evaluate(np.linspace(0.0, 10.0, 200)))
    matrix = stacked.reshape(-1, stacked.shape[2])
    outside = matrix - matrix @ space.basis @ space.basis.T
    assert np.abs(outside).max() < 1e-9 * np.abs(matrix).max()
    assert np.linalg.matrix_rank(matrix[:, space.base_columns]) == space.rank


@pytest.mark.parametrize(('urdf', 'locked', 'base'), [('ur10_robot.urdf', (), 36)])
def test_six_joint_arm(
    example_urdf: Callable[[str], Path], urdf: str, locked: tuple[str, ...], base: int
) -> None:
    arm = load_robot(example_urdf(urdf), locked=locked)
    regressor = SmoothRegressor(arm)
    rigid = IdentifiableSpace.of_regressor(arm, regressor, slice(0, 10 * arm.n))
    assert rigid.rank == base  # six rotary joints, the first along gravity: 36 (Khalil)
