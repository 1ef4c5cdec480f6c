"""JointTrajectory messages for a follower."""

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.ros.controllers.trajectory_input import read_trajectory

LIMITS = JointLimits.from_config(load_arm_config())
HERE = np.array([0.1, 1.5, -0.2, 0.3])


def message(names: list[str], *rows: list[list[float]]) -> JointTrajectory:
    """Return a message with points at 1, 2, ... s: positions, and velocities if given."""
    points = [
        JointTrajectoryPoint(
            **dict(zip(('positions', 'velocities'), row, strict=False)),
            time_from_start=Duration(sec=1 + index),
        )
        for index, row in enumerate(rows)
    ]
    return JointTrajectory(joint_names=names, points=points)


def test_joints_that_are_not_named_stay() -> None:
    some = message(['joint3', 'joint1'], [[0.5, 0.6], [0.1, 0.2]], [[0.7, 0.8], [0.0, 0.0]])
    trajectory, _ = read_trajectory(LIMITS, some, 0.0, HERE)
    np.testing.assert_array_equal(trajectory.q, [[0.6, 1.5, 0.5, 0.3], [0.8, 1.5, 0.7, 0.3]])
    np.testing.assert_array_equal(trajectory.dq, [[0.2, 0.0, 0.1, 0.0], np.zeros(4)])
    assert trajectory.ddq is None


@pytest.mark.parametrize(
    ('names', 'row', 'reason'),
    [
        (['joint1', 'elbow'], [[0.1, 0.1]], 'name joints of'),
        (['joint1', 'joint1'], [[0.1, 0.1]], 'name joints of'),
        ([], [[]], 'name joints of'),
        (['joint1', 'joint3'], [[0.1, 0.2], [0.1, 0.2, 0.3]], 'point 0 has 3 instead of 2'),
    ],
)
def test_other_names_and_numbers_of_values_are_rejected(names, row, reason: str) -> None:
    with pytest.raises(RejectedInputError, match=reason):
        read_trajectory(LIMITS, message(names, row), 0.0, HERE)
