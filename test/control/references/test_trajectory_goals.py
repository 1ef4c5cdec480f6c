"""Goals of a follower whose arm lags by a given error, in the test's own time."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.control.references.trajectory_goals import (
    ABORTED,
    CANCELED,
    SUCCEEDED,
    ResultCode,
    TrajectoryGoals,
    resolve_tolerances,
)

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
HOME = np.array([0.0, 1.5, 0.0, 0.0])
AWAY = np.array([0.3, 1.2, -0.2, 0.3])
CYCLE = 1e-2
TOLERANCES = FollowerTolerances.uniform(4, path=0.2, goal=0.01, goal_time=0.5)
REACHED = SUCCEEDED, ResultCode.SUCCESSFUL
INVALID = ABORTED, ResultCode.INVALID_GOAL


class FollowingArm:
    """A follower with its goals, and an arm that is off its reference by `lag` [rad]."""

    def __init__(self, limits: JointLimits) -> None:
        self.follower = TrajectoryFollower(limits, TOLERANCES)
        self.follower.take_over(HOME)
        self.ended: list = []
        self.goals = TrajectoryGoals(self.follower, lambda *ended: self.ended.append(ended))
        self.limits = limits
        self.now = 100.0
        self.lag = np.zeros(4)

    def start(self, goal: str, q: np.ndarray = AWAY, seconds: float = 1.0, **options) -> None:
        trajectory = JointTrajectory(self.limits, NAMES, [seconds], [q])
        self.goals.start(goal, trajectory, self.now, **options)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / CYCLE)):
            self.now += CYCLE
            self.follower.update(self.follower.reference.q + self.lag, self.now, CYCLE)
            self.goals.update()

    def results(self) -> list:
        return [(goal, result.state, result.code) for goal, result in self.ended]


@pytest.fixture
def arm(limits: JointLimits) -> FollowingArm:
    return FollowingArm(limits)


def test_a_goal_succeeds_at_the_end_of_its_trajectory_even_if_another_was_rejected(
    arm: FollowingArm,
) -> None:
    arm.start('a')
    arm.run(0.5)
    with pytest.raises(RejectedInputError):
        arm.start('wild', AWAY + 0.5, 0.02)
    arm.run(0.4)
    assert (arm.ended, arm.goals.active) == ([], 'a')
    arm.run(0.2)
    assert arm.results() == [('a', *REACHED)]
    assert arm.goals.active is None
    np.testing.assert_allclose(arm.follower.reference.q, AWAY, atol=1e-9)
    arm.run(2.0)
    assert len(arm.ended) == 1


@pytest.mark.parametrize('distance', [0.0, 0.08])
def test_a_goal_of_one_point_for_now_is_a_posture_and_no_stream(
    arm: FollowingArm, distance: float
) -> None:
    # As planners send it for an arm that is where it shall be.
    arm.start('a', HOME + distance, 0.0)
    arm.run(2.0)
    assert arm.results() == [('a', *REACHED)]
    np.testing.assert_allclose(arm.follower.reference.q, HOME + distance, atol=1e-9)
    with pytest.raises(RejectedInputError, match='end at rest'):
        moving = JointTrajectory(arm.limits, NAMES, [0.0], [HOME + distance], [[0.5] * 4])
        arm.goals.start('b', moving, arm.now)


def test_cancelling_brakes_and_holds(arm: FollowingArm) -> None:
    arm.start('a')
    arm.run(0.5)
    arm.goals.cancel('another', arm.now)
    assert arm.ended == []
    arm.goals.cancel('a', arm.now)
    arm.run(1.0)
    assert np.abs(arm.follower.reference.dq).max() < 1e-9
    assert np.abs(arm.follower.reference.q - AWAY).max() > 0.02
    arm.goals.cancel('a', arm.now)
    assert arm.results() == [('a', CANCELED, ResultCode.SUCCESSFUL)]


def test_a_new_goal_replaces_the_old_one_without_a_step(arm: FollowingArm) -> None:
    arm.start('a')
    arm.run(0.5)
    before = arm.follower.reference
    arm.start('b', before.q, 1.0)
    arm.run(CYCLE)
    assert np.abs(arm.follower.reference.q - before.q).max() < 2.0 * CYCLE
    arm.run(1.2)
    assert arm.results() == [('a', *INVALID), ('b', *REACHED)]


def lag(*error: float) -> Callable[[FollowingArm], None]:
    return lambda arm: setattr(arm, 'lag', np.array(error))


def end_control(arm: FollowingArm) -> None:
    arm.goals.give_up("the arm is 'fault'")


@pytest.mark.parametrize(
    ('event', 'code', 'text'),
    [
        (lag(0.0, 0.0, 0.25, 0.0), ResultCode.PATH_TOLERANCE_VIOLATED, 'stopped: joint3 is 0.25'),
        (lag(0.05, 0, 0, 0), ResultCode.GOAL_TOLERANCE_VIOLATED, 'joint1 is 0.05 rad off'),
        (lambda arm: arm.follower.go_to(HOME, arm.now), ResultCode.INVALID_GOAL, ''),
        (lambda arm: arm.follower.stop(arm.now, 'stopped'), ResultCode.INVALID_GOAL, ''),
        (lambda arm: arm.follower.take_over(HOME), ResultCode.INVALID_GOAL, ''),
        (end_control, ResultCode.INVALID_GOAL, "the arm is 'fault'"),
    ],
    ids=['off the path', 'off the goal', 'set point', 'stop', 'activation', 'end of control'],
)
def test_whatever_keeps_the_arm_from_its_goal_aborts_it_once(
    arm: FollowingArm, event: Callable[[FollowingArm], None], code: ResultCode, text: str
) -> None:
    arm.start('a')
    arm.run(0.5)
    event(arm)
    arm.run(CYCLE)
    if code is ResultCode.GOAL_TOLERANCE_VIOLATED:  # the goal time is 0.5 s
        arm.run(0.94)
        assert arm.ended == []
        arm.run(0.1)
    assert arm.results() == [('a', ABORTED, code)]
    assert text in arm.ended[0][1].text
    arm.run(2.0)
    assert arm.follower.status == 'holding'
    arm.goals.give_up('the end')
    assert len(arm.ended) == 1


OWN = FollowerTolerances.uniform(4, path=0.3, goal=0.01, goal_time=1.0)


def test_each_joint_has_its_own_tolerance_and_minus_one_disables_it() -> None:
    used = resolve_tolerances(
        OWN, NAMES, [('joint3', 0.1)], [('joint1', -1.0), ('joint4', 0.5)], -1.0
    )
    np.testing.assert_array_equal(used.path, [0.3, 0.3, 0.1, 0.3])
    np.testing.assert_array_equal(used.goal, [np.inf, 0.01, 0.01, 0.5])
    assert used.goal_time == np.inf
    for given in (
        {'path': [('elbow', 0.1)]},
        {'goal': [('joint1', -0.5)]},
        {'goal': [('joint1', np.nan)]},
        {'path': [('joint1', np.inf)]},
        {'goal_time': -2.0},
    ):
        with pytest.raises(RejectedInputError, match='joint1|elbow|goal_time'):
            resolve_tolerances(OWN, NAMES, **given)
