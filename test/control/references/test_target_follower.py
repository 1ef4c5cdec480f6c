import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.references.target_follower import TargetFollower
from aerarm_ros.model.kinematics import Kinematics

CYCLE = 1e-3
POSTURE = np.array([0.3, 1.1, 0.4, 0.9])


@pytest.fixture
def follower(robot) -> TargetFollower:
    follower = TargetFollower(Kinematics(robot), reach=1.2)
    follower.take_over(POSTURE)
    return follower


def play(follower, seconds, start=0.0):
    cycles = range(1, round(seconds / CYCLE) + 1)
    return np.array([follower.update(POSTURE, start + i * CYCLE, CYCLE) for i in cycles])


def test_reaches_a_target_without_overshoot_and_within_limits(follower) -> None:
    start = play(follower, 0.001)[-1, 0]
    goal = start + [0.2, -0.1, 0.1]
    follower.set_target(goal, 0.0)
    rows = play(follower, 2.0)
    progress = (rows[:, 0] - start) @ (goal - start) / ((goal - start) @ (goal - start))
    assert progress[-1] == pytest.approx(1.0, abs=1e-3)
    assert progress.max() < 1.005
    assert np.linalg.norm(rows[:, 1], axis=1).max() <= 0.81
    assert np.linalg.norm(rows[:, 2], axis=1).max() <= 4.001
    slope = np.gradient(rows[:, 0], CYCLE, axis=0)
    np.testing.assert_allclose(slope[1:-1], rows[1:-1, 1], atol=5e-3)


def test_a_stream_is_followed_without_lag_and_its_end_is_the_target(follower) -> None:
    start = play(follower, 0.001)[-1, 0]
    velocity = np.array([0.0, 0.5, 0.05])
    for k in range(50):
        last = start + 0.02 * k * velocity
        follower.set_target(last, 0.02 * k)
        rows = play(follower, 0.02, start=0.02 * k)
    np.testing.assert_allclose(rows[-1, 0], last + 0.02 * velocity, atol=1e-3)
    np.testing.assert_allclose(rows[-1, 1], velocity, atol=1e-3)
    rows = play(follower, 3.0, start=1.0)
    np.testing.assert_allclose(rows[-1, 0], last, atol=1e-3)
    assert np.linalg.norm(rows[-1, 1]) < 1e-3
    # Beyond it only by what 0.5 m/s need to be braked.
    assert (rows[:, 0] - last)[:, 1].max() < 0.06


@pytest.mark.parametrize(
    ('target', 'message'),
    [
        ([0, np.nan, 0], 'finite'),
        ([650.0, 0, 0], 'beyond the reach of the arm'),
        ([0, 1.2001, 0], '0.0001 m beyond'),
        ([1], 'three'),
    ],
)
def test_a_wrong_target_is_rejected(follower, target, message) -> None:
    before = play(follower, 0.001)[-1]
    with pytest.raises(RejectedInputError, match=message):
        follower.set_target(target, 0.0)
    np.testing.assert_array_equal(play(follower, 0.1)[-1], before)
