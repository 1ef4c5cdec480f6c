"""A stream that is followed with limited velocity and acceleration."""

import numpy as np
import pytest

from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.reference_chase import MotionLimit, ReferenceChase
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.motion.signals import JointReference

LIMITS = JointLimits.from_config(load_arm_config())
CYCLE = 1e-3
START = np.array([0.0, 1.5, 0.0, 0.5])
MOST = np.array([2.0, 2.0, 5.0, 5.0])
TURNING = np.array([-0.5, 0.0, -0.02, 0.0])


def chase(turn_max: float = np.inf) -> ReferenceChase:
    """Return a chase with constant limits."""
    found = ReferenceChase(LIMITS, lambda q, dq, most: MotionLimit(MOST, TURNING, turn_max))
    found.start(JointReference.at_rest(START))
    return found


def sines(time: float, amplitude: float, frequency: float) -> JointReference:
    w = 2.0 * np.pi * frequency
    away = amplitude * np.array([1.0, -0.5, 0.8, 0.6])
    return JointReference(
        START + away * (1.0 - np.cos(w * time)),
        away * w * np.sin(w * time),
        away * w**2 * np.cos(w * time),
    )


def followed(found: ReferenceChase, amplitude: float, frequency: float) -> list[JointReference]:
    """Return the result for 3 s of sines and 4 s at their end."""
    times = CYCLE * np.arange(7000)
    rows = [sines(time, amplitude, frequency) for time in times[:3000]]
    rows += [JointReference.at_rest(rows[-1].q)] * 4000
    return [found.update(row, CYCLE, is_limited=True) for row in rows]


def test_a_slow_stream_is_followed_exactly() -> None:
    found = chase()
    for time in CYCLE * np.arange(2000):
        wanted = sines(time, 0.1, 0.2)
        assert found.update(wanted, CYCLE, is_limited=True) is wanted
    assert not found.is_behind


def test_a_fast_stream_is_followed_within_the_limits_and_reached_at_last() -> None:
    found = chase()
    rows = followed(found, 0.5, 1.0)
    ddq = np.array([row.ddq for row in rows])
    dq = np.array([row.dq for row in rows])
    assert (np.abs(ddq).max(axis=0) <= MOST + 1e-9).all()
    assert (np.abs(dq).max(axis=0) <= 0.45 * MOST).all()
    steps = np.abs(np.diff(dq, axis=0) - CYCLE * ddq[1:]).max(axis=1)
    assert (steps > 1e-6).sum() <= 1, 'the velocity steps only where the stream is reached'
    assert steps.max() < 2e-3
    assert rows[-1].q == pytest.approx(sines(2.999, 0.5, 1.0).q, abs=1e-4)
    assert not found.is_behind


def test_the_momentum_about_the_vertical_stays_below_its_limit() -> None:
    free = np.array([TURNING @ row.dq for row in followed(chase(), 0.5, 0.5)])
    rows = followed(chase(turn_max=0.1), 0.5, 0.5)
    turned = np.array([TURNING @ row.dq for row in rows])
    assert np.abs(free).max() > 0.2
    assert np.abs(turned).max() < 0.11
    assert np.ptp([row.q[3] for row in rows]) > 0.3, 'joints that do not turn the drone keep moving'


def test_a_position_limit_is_not_passed() -> None:
    """The followed reference rests at the limit; the chase arrives there with full speed."""
    found = ReferenceChase(LIMITS, lambda q, dq, most: MotionLimit(0.1 * MOST, TURNING, np.inf))
    end = LIMITS.position_max[3]
    q = START.copy()
    q[3] = end - 0.02
    dq = np.array([0.0, 0.0, 0.0, 0.8])
    found.start(JointReference(q, dq, np.zeros(4)))
    q = q.copy()
    q[3] = end
    reached = [found.update(JointReference.at_rest(q), CYCLE, True).q[3] for _ in range(500)]
    assert max(reached) <= end


def test_the_forecast_equals_the_later_references() -> None:
    found, times = chase(), 0.02 * np.arange(6)
    for time in CYCLE * np.arange(400):
        found.update(sines(time, 0.5, 1.0), CYCLE, is_limited=True)
    rows = [sines(0.399 + time, 0.5, 1.0) for time in times]
    ahead = found.ahead(JointReference(*map(np.array, zip(*rows, strict=True))), times, True)
    for step in range(1, 101):
        last = found.update(sines(0.399 + CYCLE * step, 0.5, 1.0), CYCLE, is_limited=True)
    assert ahead.q[-1] == pytest.approx(last.q, abs=5e-3)
    assert np.abs(ahead.q[-1] - rows[-1].q).max() > 0.05


def streamed(found: ReferenceChase | None) -> TrajectoryFollower:
    """Return a follower after 0.5 s of a fast stream at 100 Hz."""
    follower = TrajectoryFollower(LIMITS, FollowerTolerances.uniform(4), chase=found)
    follower.take_over(START)
    for cycle in range(500):
        now = CYCLE * cycle
        if cycle % 10 == 0:
            point = [[row.tolist()] for row in sines(now, 0.3, 0.8)]
            follower.follow(JointTrajectory(LIMITS, LIMITS.names, [0.0], *point), now)
        follower.update(follower.reference.q, now, CYCLE)
    return follower


def test_a_stop_begins_where_the_lagging_arm_is() -> None:
    follower = streamed(chase())
    before = follower.reference
    follower.stop(0.5, 'stopped')
    after = follower.update(before.q, 0.5 + CYCLE, CYCLE)
    assert after.q == pytest.approx(before.q + CYCLE * before.dq, abs=1e-4)
    for cycle in range(501, 2500):
        follower.update(follower.reference.q, CYCLE * cycle, CYCLE)
    travel = np.abs(follower.reference.q - before.q)
    assert (travel < 0.1).all(), 'the arm does not first finish the stream'
