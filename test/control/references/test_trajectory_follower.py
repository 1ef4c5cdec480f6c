"""References never step, for any input; rejected inputs change nothing."""

import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
HOME = np.array([0.0, 1.5, 0.0, 0.0])
AWAY = np.array([0.8, 1.0, -0.6, 0.7])
CYCLE = 1e-3


@pytest.fixture
def follower(limits) -> TrajectoryFollower:
    follower = TrajectoryFollower(limits, FollowerTolerances.uniform(4))
    follower.take_over(HOME)
    return follower


def play(follower, seconds, start=0.0, events=None, cycle_time=CYCLE):
    """Return references (M, 3, n) of a run in which the arm follows exactly."""
    rows = []
    for cycle in range(round(seconds / cycle_time)):
        now = start + cycle * cycle_time
        if events and cycle in events:
            events[cycle](now)
        rows.append(follower.update(follower.reference.q, now, cycle_time))
    return np.array(rows)


def assert_continuous(rows, limits, cycle_time=CYCLE) -> None:
    q, dq, ddq = rows[:, 0], rows[:, 1], rows[:, 2]
    assert np.all(np.abs(np.diff(q, axis=0)) <= 1.5 * cycle_time * limits.velocity_max)
    assert np.all(np.abs(np.diff(dq, axis=0)) <= 1.5 * cycle_time * limits.acceleration_max)
    # Velocity and acceleration belong to the positions.
    np.testing.assert_allclose(np.gradient(q, cycle_time, axis=0)[1:-1], dq[1:-1], atol=5e-3)
    np.testing.assert_allclose(np.gradient(dq, cycle_time, axis=0)[1:-1], ddq[1:-1], atol=0.5)


def test_goes_to_a_set_point_within_the_limits(follower, limits) -> None:
    follower.go_to(AWAY, 0.0)
    rows = play(follower, 3.0)
    assert_continuous(rows, limits)
    np.testing.assert_allclose(rows[-1, 0], AWAY, atol=1e-12)
    assert np.all(np.abs(rows[:, 1]).max(axis=0) <= 0.51 * limits.velocity_max)
    assert follower.status == 'holding'
    assert follower.outcome.startswith('goal reached')


@pytest.mark.parametrize('delay', [0.3, -0.2])
def test_a_trajectory_starts_at_its_stamp(follower, limits, delay) -> None:
    slow = JointTrajectory(limits, NAMES, [0.0, 2.0], [HOME, AWAY])
    expected = slow.path(HOME)
    follower.follow(slow, 0.0, start=delay)
    rows = play(follower, 2.5)
    assert_continuous(rows, limits)
    for cycle in (1000, 1800):
        now = cycle * CYCLE - delay
        np.testing.assert_allclose(rows[cycle, 0], expected.evaluate(now).q, atol=1e-9)


def test_a_streamed_sine_is_followed(follower, limits) -> None:
    def point(now):
        q = HOME + 0.3 * (1 - np.cos(2 * now))
        velocity, acceleration = 0.6 * np.sin(2 * now), 1.2 * np.cos(2 * now)
        follower.follow(
            JointTrajectory(limits, NAMES, [0.0], [q], [[velocity] * 4], [[acceleration] * 4]), now
        )

    rows = play(follower, 2.0, events=dict.fromkeys(range(0, 2000, 10), point))
    assert_continuous(rows, limits)
    time = np.arange(2000) * CYCLE
    expected = HOME + 0.3 * (1 - np.cos(2 * time))[:, np.newaxis]
    assert np.abs(rows[500:, 0] - expected[500:]).max() < 1e-3


def test_a_silent_stream_brakes(follower, limits) -> None:
    point = JointTrajectory(limits, NAMES, [0.0], [HOME], [[0.5, 0.0, 0.0, -0.5]])
    follower.follow(point, 0.0)
    fine = CYCLE / 20.0  # the braking takes 14 ms
    rows = play(follower, 0.2, cycle_time=fine)
    assert_continuous(rows, limits, fine)
    assert not rows[-1, 1:].any()
    assert 'no streamed point' in follower.outcome


def test_an_arm_that_lags_stops_the_motion_where_it_is(follower, limits) -> None:
    follower.follow(JointTrajectory(limits, NAMES, [0.0, 2.0], [HOME, AWAY]), 0.0)
    rows = []
    for cycle in range(3000):
        rows.append(follower.update(HOME, cycle * CYCLE, CYCLE))
    assert_continuous(np.array(rows), limits)
    assert follower.status == 'holding'
    assert 'off path' in follower.outcome
    np.testing.assert_allclose(rows[-1].q, HOME)


def test_rejected_input_changes_nothing(follower, limits) -> None:
    follower.go_to(AWAY, 0.0)
    before = play(follower, 0.3)[-1]
    far = JointTrajectory(limits, NAMES, [0.0, 1.0], [HOME + 0.9, AWAY])
    with pytest.raises(RejectedInputError, match='start at the present position'):
        follower.follow(far, 0.3)
    with pytest.raises(RejectedInputError, match='joint2 at 9 rad'):
        follower.go_to(np.array([0.0, 9.0, 0.0, 0.0]), 0.3)
    with pytest.raises(RejectedInputError, match='slow the motion down'):
        follower.follow(JointTrajectory(limits, NAMES, [0.05], [AWAY]), 0.3)
    rows = play(follower, 3.0, start=0.3)
    np.testing.assert_allclose(rows[0, 0], before[0], atol=5 * CYCLE)
    np.testing.assert_allclose(rows[-1, 0], AWAY)


def test_the_forecast_equals_the_later_references(follower) -> None:
    follower.go_to(AWAY, 0.0)
    play(follower, 0.3)
    follower.go_to(HOME, 0.3)  # a blend is under way, and ends meanwhile
    for begin in (0.3, 0.4, 3.0):
        rows = play(follower, 0.01, start=begin)
        now = begin + 0.009
        times = now + np.linspace(0.0, 0.1, 6)
        told = follower.ahead(times)
        np.testing.assert_array_equal(told.q[0], rows[-1, 0])
        done = play(follower, 0.101, start=now)[::20]
        np.testing.assert_allclose(np.stack(told, axis=1), done, atol=1e-9)


def test_a_goal_is_checked_as_it_would_begin_and_changes_nothing(follower) -> None:
    before = follower.motion, follower.status
    follower.check_goal(JointTrajectory(follower.limits, NAMES, [2.0], [AWAY]), 1.0)
    with pytest.raises(
        RejectedInputError, match=r'joint1 needs 14\.9 rad/s, 9\.92 more than its limit of 5;'
    ):
        follower.check_goal(JointTrajectory(follower.limits, NAMES, [0.1], [AWAY]), 1.0)
    moving = [[0.0, 0.0, 0.0, 0.5]]
    with pytest.raises(RejectedInputError, match=r'a velocity, joint4 0\.5 rad/s \(limit 0\.005\)'):
        follower.check_goal(JointTrajectory(follower.limits, NAMES, [2.0], [AWAY], moving), 1.0)
    assert (follower.motion, follower.status) == before
