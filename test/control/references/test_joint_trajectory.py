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


REST, FAST = [0.0] * 4, [0.5] * 4


@pytest.mark.parametrize(
    ('message', 'times', 'positions', 'velocities', 'names'),
    [
        ('elbow', [0.0], [START], None, ('joint1', 'joint2', 'joint3', 'elbow')),
        ('do not match the arm', [0.0], [START[:3]], None, NAMES[:3]),
        ('point 2 at 1 s does not follow', [0.0, 1.0, 1.0], [START, MIDDLE, END], None, NAMES),
        ('must increase', [0.0, -1.0], [START, END], None, NAMES),
        ('not negative', [-1.0], [START], None, NAMES),
        ('finite', [np.nan], [START], None, NAMES),
        ('no points', [], [], None, NAMES),
        ('no positions', [0.0], [[]], None, NAMES),
        ('point 1 has 2 instead of 4', [0.0, 1.0], [START, END[:2]], None, NAMES),
        ('finite', [0.0], [[0.0, np.nan, 0.0, 0.0]], None, NAMES),
        ('joint2 at 4 rad is outside', [0.0, 1.0], [START, [0.0, 4.0, 0.0, 0.0]], None, NAMES),
        ('slow the motion down', [0.0, 0.01], [START, END], None, NAMES),
        ('end at rest', [0.0, 1.0], [START, END], [REST, FAST], NAMES),
        # At the limit with a velocity that leads beyond it.
        (
            'between its points: joint2',
            [0.0, 1.0, 2.0],
            [START, [0.0, 3.66, 0.0, 0.0], START],
            [REST, [0.0, 1.0, 0.0, 0.0], REST],
            NAMES,
        ),
        # Slow enough on average, but reached from rest too soon.
        (r'between its points: joint2 needs .* rad/s\^2', [0.4], [[0, 1.0, 0, 0]], None, NAMES),
    ],
)
def test_a_wrong_trajectory_is_rejected(
    limits, message, times, positions, velocities, names
) -> None:
    with pytest.raises(RejectedInputError, match=message):
        JointTrajectory(limits, names, times, positions, velocities).path(np.array(START))


def test_too_large_an_acceleration_is_rejected(limits) -> None:
    rows = [[START], [REST], [[0.0, 16.0, 0.0, 0.0]]]
    with pytest.raises(RejectedInputError, match=r'joint2 needs 16 rad/s\^2'):
        JointTrajectory(limits, NAMES, [0.0], *rows)


def test_an_arm_beyond_its_limits_may_come_back(limits) -> None:
    beyond = np.array([0.0, limits.position_min[1] - 0.03, 0.0, 0.0])
    path = JointTrajectory(limits, NAMES, [2.0], [START]).path(beyond)
    np.testing.assert_allclose(path.evaluate(0.0).q, beyond)
    np.testing.assert_allclose(path.evaluate(2.0).q, START)
