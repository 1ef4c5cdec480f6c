"""Rejected trajectories, and the motion of an accepted one."""

import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
START = [0.0, 1.5, 0.0, 0.0]
MIDDLE = [0.2, 1.3, 0.1, -0.2]
END = [0.3, 1.2, -0.3, 0.4]


def test_path_passes_the_points_and_rests_at_the_end(limits) -> None:
    trajectory = JointTrajectory(limits, NAMES, [0.0, 1.0, 2.0], [START, MIDDLE, END])
    path = trajectory.path(np.array(START))
    np.testing.assert_allclose(path.evaluate(1.0).q, MIDDLE)
    np.testing.assert_allclose(path.evaluate(2.0 - 1e-9).q, END, atol=1e-8)
    assert np.abs(path.evaluate(2.0 - 1e-9).dq).max() < 1e-6
    # Under way it doesn't stop.
    assert np.abs(path.evaluate(1.0).dq).min() > 0.05


def test_a_first_point_in_the_future_is_reached_from_the_present(limits) -> None:
    here = np.array([0.1, 1.6, 0.1, 0.1])
    path = JointTrajectory(limits, NAMES, [1.0], [END]).path(here)
    np.testing.assert_allclose(path.evaluate(0.0).q, here)
    np.testing.assert_allclose(path.evaluate(1.0).q, END)


@pytest.mark.parametrize(
    ('names', 'times', 'positions', 'message'),
    [
        (('joint1', 'joint2', 'joint3', 'elbow'), [0.0], [START], 'elbow'),
        (NAMES[:3], [0.0], [START[:3]], 'do not match the arm'),
        (NAMES, [0.0, 1.0, 1.0], [START, MIDDLE, END], 'point 2 at 1 s does not follow'),
        (NAMES, [0.0, -1.0], [START, END], 'must increase'),
        (NAMES, [-1.0], [START], 'not negative'),
        (NAMES, [np.nan], [START], 'finite'),
        (NAMES, [], [], 'no points'),
        (NAMES, [0.0], [[]], 'no positions'),
        (NAMES, [0.0, 1.0], [START, END[:2]], 'positions: give 4 values for every point'),
        (NAMES, [0.0], [[0.0, np.nan, 0.0, 0.0]], 'finite'),
        (NAMES, [0.0, 1.0], [START, [0.0, 4.0, 0.0, 0.0]], 'joint2 at 4 rad is outside'),
    ],
)
def test_a_wrong_trajectory_is_rejected(limits, names, times, positions, message) -> None:
    with pytest.raises(RejectedInputError, match=message):
        JointTrajectory(limits, names, times, positions)


def test_too_large_an_acceleration_is_rejected(limits) -> None:
    rows = [[START], [[0.0] * 4], [[0.0, 16.0, 0.0, 0.0]]]
    with pytest.raises(RejectedInputError, match=r'joint2 needs 16 rad/s\^2'):
        JointTrajectory(limits, NAMES, [0.0], *rows)
    # Slow enough on average, but reached from rest too soon.
    hurried = JointTrajectory(limits, NAMES, [0.4], [[0.0, 1.0, 0.0, 0.0]])
    with pytest.raises(RejectedInputError, match=r'between its points: joint2 needs .* rad/s\^2'):
        hurried.path(np.array(START))


@pytest.mark.parametrize(
    ('times', 'positions', 'velocities', 'message'),
    [
        ([0.0, 0.01], [START, END], None, 'slow the motion down'),
        ([0.0, 1.0], [START, END], [[0.0] * 4, [0.5] * 4], 'end at rest'),
        # At the limit with a velocity that leads beyond it.
        (
            [0.0, 1.0, 2.0],
            [START, [0.0, 3.66, 0.0, 0.0], START],
            [[0.0] * 4, [0.0, 1.0, 0.0, 0.0], [0.0] * 4],
            'between its points: joint2',
        ),
    ],
)
def test_a_motion_outside_the_limits_is_rejected(
    limits, times, positions, velocities, message
) -> None:
    trajectory = JointTrajectory(limits, NAMES, times, positions, velocities)
    with pytest.raises(RejectedInputError, match=message):
        trajectory.path(np.array(START))


def test_an_arm_beyond_its_limits_may_come_back(limits) -> None:
    beyond = np.array([0.0, limits.position_min[1] - 0.03, 0.0, 0.0])
    path = JointTrajectory(limits, NAMES, [2.0], [START]).path(beyond)
    np.testing.assert_allclose(path.evaluate(0.0).q, beyond)
    np.testing.assert_allclose(path.evaluate(2.0).q, START)
