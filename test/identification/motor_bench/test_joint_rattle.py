"""Joints that rattle when another one swings."""

import numpy as np
import pytest

from aerarm_ros.description.robot import load_robot
from aerarm_ros.identification.motor_bench.motor_bench import backlash_shifts
from aerarm_ros.model.dynamics import Dynamics

DYNAMICS = Dynamics(load_robot())
UPRIGHT, LEANING, LEVEL = [0.0, 1.5708, 0.0, 0.0], [0.0, 1.0, 0.0, -0.5708], [0.0, 0.3, 0.0, 0.0]


@pytest.mark.parametrize(
    ('joint', 'posture', 'loose'),
    [
        # Joints 1 and 3 turn about one axis, and nothing presses joint 2 or 4.
        (0, UPRIGHT, [2]),
        (2, UPRIGHT, [0]),
        (3, UPRIGHT, [1]),
        # The whole arm is heavy: what rattles at its end does not move it.
        (1, UPRIGHT, []),
        (0, LEVEL, []),
        # Gravity presses joint 2, while link 4 stands on its head.
        (3, LEANING, []),
    ],
)
def test_a_joint_that_is_moved_and_not_pressed_moves_within_its_backlash(
    joint: int, posture: list, loose: list
) -> None:
    shift = backlash_shifts(DYNAMICS, np.array(posture), joint, 0.25, 20.0)
    assert np.flatnonzero(shift > 3e-3).tolist() == loose
    assert shift.max() < 0.06
