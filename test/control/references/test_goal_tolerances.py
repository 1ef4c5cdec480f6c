import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances
from aerarm_ros.control.references.trajectory_goals import resolve_tolerances

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
OWN = FollowerTolerances.uniform(4, path=0.3, goal=0.01, goal_time=1.0)


def test_missing_tolerances_are_those_of_the_follower() -> None:
    used = resolve_tolerances(OWN, NAMES, [('joint2', 0.0)], [], 0.0)
    np.testing.assert_array_equal(used.path, OWN.path)
    np.testing.assert_array_equal(used.goal, OWN.goal)
    assert used.goal_time == OWN.goal_time


def test_each_joint_has_its_own_tolerance_and_minus_one_disables_it() -> None:
    used = resolve_tolerances(
        OWN, NAMES, [('joint3', 0.1)], [('joint1', -1.0), ('joint4', 0.5)], -1.0
    )
    np.testing.assert_array_equal(used.path, [0.3, 0.3, 0.1, 0.3])
    np.testing.assert_array_equal(used.goal, [np.inf, 0.01, 0.01, 0.5])
    assert used.goal_time == np.inf
    np.testing.assert_array_equal(OWN.path, [0.3] * 4)


@pytest.mark.parametrize(
    'given',
    [
        {'path': [('elbow', 0.1)]},
        {'goal': [('joint1', -0.5)]},
        {'goal': [('joint1', np.nan)]},
        {'path': [('joint1', np.inf)]},
        {'goal_time': -2.0},
    ],
)
def test_invalid_tolerances_are_rejected(given: dict) -> None:
    with pytest.raises(RejectedInputError, match='joint1|elbow|goal_time'):
        resolve_tolerances(OWN, NAMES, **given)
