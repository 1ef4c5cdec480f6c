"""Stops and preemptions of a trajectory follower: distances and limits, see stopping_campaign."""

import numpy as np
import pytest
from stopping_campaign import CYCLE, SHARES, TRAVELS, make_follower, run_preemptions

from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory


@pytest.mark.parametrize('travel', TRAVELS)
@pytest.mark.parametrize('share', SHARES)
def test_a_stop_travels_at_most_half_as_much_again_as_the_limits_need(
    limits: JointLimits, travel, share: float
) -> None:
    for joint in range(limits.n):
        speed = share * limits.velocity_max[joint]
        least = speed**2 / (2.0 * limits.acceleration_max[joint])
        assert least <= travel(limits, joint, speed) <= 1.5 * least


def test_no_preemption_leads_beyond_a_limit(limits: JointLimits) -> None:
    tally = run_preemptions(limits, 300, seed=7)
    assert tally.tried == 300
    assert tally.beyond < 1e-6
    assert tally.velocity < 1.002
    assert tally.acceleration < 1.005
    # Most are executed: what is rejected was made to leave the limits by itself.
    assert 'set_point' not in tally.rejected
    assert tally.rejected.get('replanned', 0) + tally.rejected.get('trajectory', 0) < 40


def test_a_goal_that_replaces_a_fast_motion_near_a_limit_keeps_to_it(limits: JointLimits) -> None:
    """A separate blend of each joint led joint 2 to 3.91 rad; its limit is 3.664."""
    start, end = np.array([0.0, 0.4, 0.0, 0.0]), np.array([0.0, 3.6, 0.0, 0.0])
    follower = make_follower(limits, start)
    follower.follow(JointTrajectory(limits, limits.names, [1.3], [end]), 0.0)
    follower.update(start, 0.715, CYCLE)
    there = follower.reference
    assert there.dq[1] > 4.5
    assert there.q[1] > 2.2
    # As a planner sends it that knows where the arm is, but not how fast.
    stay = JointTrajectory(limits, limits.names, [0.0], [there.q])
    follower.follow(stay, 0.715, is_goal=True)
    rows = follower.ahead(0.715 + np.arange(0.0, 4.0, CYCLE))
    assert rows.q[:, 1].max() <= limits.position_max[1]
    assert np.all(np.abs(rows.ddq) <= 1.001 * limits.acceleration_max)
    np.testing.assert_allclose(rows.q[-1], there.q, atol=1e-9)


def test_a_canceled_trajectory_stays_on_its_path(limits: JointLimits) -> None:
    points = [[0.5, 1.0, -0.6, 0.7], [1.2, 1.6, 0.5, 0.1], [0.3, 1.2, 0.9, -0.8]]
    trajectory = JointTrajectory(limits, limits.names, [0.6, 1.2, 1.8], points)
    path = trajectory.path(np.array([0.0, 1.5, 0.0, 0.0]))
    on_path = path.evaluate(np.linspace(0.0, path.duration, 12_000)).q
    for now in np.arange(0.3, 1.8, 0.4):
        follower = make_follower(limits, np.array([0.0, 1.5, 0.0, 0.0]))
        follower.follow(trajectory, 0.0)
        follower.update(follower.reference.q, now, CYCLE)
        follower.stop(now, 'canceled')
        rows = follower.ahead(now + np.arange(0.0, 0.6, 1e-2))
        distance = np.linalg.norm(rows.q[:, np.newaxis] - on_path, axis=2).min(axis=1)
        assert distance.max() < 1e-3
        assert not rows.dq[-1].any()


def test_a_stream_toward_a_limit_brakes_in_time_to_stop_before_it(limits: JointLimits) -> None:
    follower = make_follower(limits, np.array([0.0, 1.0, 0.0, 0.0]))
    largest, now = 0.0, 0.0
    while now < 1.4:
        # It comes to 3 rad/s, and would be at the limit 0.12 s after its last point.
        rate = min(8.0 * now, 3.0)
        q = 1.0 + 4.0 * min(now, 0.375) ** 2 + 3.0 * max(now - 0.375, 0.0)
        rows = [[[0.0, value, 0.0, 0.0]] for value in (q, rate, 8.0 * (rate < 3.0))]
        try:
            if now < 0.95:
                follower.follow(JointTrajectory(limits, limits.names, [0.0], *rows), now)
        except RejectedInputError as error:
            rejected = str(error)
        for _ in range(10):
            reference = follower.update(follower.reference.q, now, CYCLE)
            largest = max(largest, reference.q[1])
            now += CYCLE
    assert 3.4 < largest <= limits.position_max[1]
    assert 'stopped before a joint limit' in follower.outcome
    assert 'stopping position of the streamed point: joint2 at 3.6' in rejected
    assert not reference.dq.any()
