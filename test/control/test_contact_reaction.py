"""Reactions of a trajectory follower and its law to contact."""

import numpy as np
import pytest

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits, RejectedInputError
from aerarm_ros.control.compensation import MomentumObserver
from aerarm_ros.control.contact_reaction import ContactReaction
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.control.references.joint_trajectory import JointTrajectory
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.motion.signals import ArmState, Reaction

CYCLE = 1e-3
START, GOAL = np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.8, 1.4, 0.5, -0.5])


class Moving:
    """An arm that is always where its reference is, on the way from START to GOAL in 2 s."""

    def __init__(self, reaction: Reaction) -> None:
        robot = load_robot()
        self.limits = JointLimits.from_config(load_arm_config())
        self.follower = TrajectoryFollower(self.limits, FollowerTolerances.uniform(4))
        dynamics = MovingBaseDynamics(robot)
        self.law = ComputedTorque(dynamics, 400.0, 40.0)
        observer = MomentumObserver(dynamics, np.full(4, 30.0))
        self.loop = ControlLoop(self.limits, self.follower, self.law, observer, None, 1.0)
        self.reaction = ContactReaction(self.follower, self.loop, self.law, retreat_time=0.2)
        self.reaction.reaction = reaction
        self.q, self.dq, self.now = START, np.zeros(4), 0.0
        self.past = [START]
        self.run(0.01)
        self.go(GOAL)

    def go(self, goal: np.ndarray) -> None:
        trajectory = JointTrajectory(self.limits, self.limits.names, [2.0], [goal])
        self.follower.follow(trajectory, self.now)

    def run(self, seconds: float, contact: bool = False) -> None:
        for _ in range(round(seconds / CYCLE)):
            self.now += CYCLE
            self.reaction.report(contact, self.now)
            self.reaction.update(self.q, self.now)
            self.loop.update(ArmState(self.q, self.dq, np.zeros(4)), self.now)
            self.q, self.dq, _ = self.follower.reference
            self.past.append(self.q)


def distance_from_path(arm: Moving) -> float:
    """Return how far the arm is from the line from START to GOAL [rad]."""
    way = (GOAL - START) / np.linalg.norm(GOAL - START)
    off = arm.q - START
    return float(np.linalg.norm(off - (off @ way) * way))


def test_report_changes_nothing_and_an_arm_at_rest_does_not_retreat() -> None:
    for reaction, free in ((Reaction.REPORT, 1.0), (Reaction.RETREAT, 3.0)):
        arm = Moving(reaction)
        arm.run(free)
        arm.run(1.2, contact=True)
        np.testing.assert_allclose(arm.q, GOAL, atol=1e-9)
        assert arm.reaction.count == 0


def test_stop_ends_on_the_path_as_fast_as_the_limits_allow() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(1.0)
    before = np.linalg.norm(arm.dq)
    assert not arm.loop.touched
    arm.run(0.15, contact=True)
    assert before > 0.5
    assert np.linalg.norm(arm.dq) == 0.0
    assert distance_from_path(arm) < 1e-9
    assert arm.follower.outcome == 'stopped: contact (stop)'
    assert arm.reaction.count == 1
    assert arm.loop.touched, 'the contact is no disturbance to compensate'
    # A stream waits for the end of the contact, a goal does not.
    with pytest.raises(RejectedInputError, match='something touches the arm'):
        arm.reaction.check_stream()
    arm.go(START)
    arm.run(2.5, contact=True)
    np.testing.assert_allclose(arm.q, START, atol=1e-9)
    arm.run(0.1)
    assert not arm.loop.touched
    arm.reaction.check_stream()


@pytest.mark.parametrize('is_braking', [False, True])
def test_retreat_goes_back_to_where_the_arm_was_even_if_it_brakes(is_braking: bool) -> None:
    arm = Moving(Reaction.RETREAT)
    arm.run(1.0)
    if is_braking:
        arm.follower.stop(arm.now, 'stopped: request')
        arm.run(0.02)
        assert np.linalg.norm(arm.dq) > 0.1
    earlier = arm.past[-200]
    arm.run(1.0, contact=True)
    np.testing.assert_allclose(arm.q, earlier, atol=0.02)
    assert distance_from_path(arm) < 1e-3
    assert arm.reaction.count == 1


def test_comply_lowers_the_stiffness_until_the_contact_has_ended() -> None:
    arm = Moving(Reaction.COMPLY)
    arm.run(1.0)
    arm.run(0.3, contact=True)
    assert arm.law.stiffness_share == pytest.approx(0.02)
    pushed = arm.q = arm.q + 0.3
    arm.now += CYCLE
    arm.reaction.report(False, arm.now)
    arm.reaction.update(arm.q, arm.now)
    assert arm.reaction.complies
    arm.now += 0.6
    arm.reaction.update(arm.q, arm.now)
    assert not arm.reaction.complies
    np.testing.assert_allclose(arm.follower.reference.q, pushed)


def test_a_retreat_that_meets_a_contact_stops() -> None:
    arm = Moving(Reaction.RETREAT)
    arm.run(1.0)
    arm.run(0.15, contact=True)
    arm.run(0.02)
    place = arm.q
    arm.run(1.0, contact=True)
    assert np.linalg.norm(arm.q - place) < 0.05
    assert np.linalg.norm(arm.q - START) < np.linalg.norm(place - START)
    assert arm.reaction.count == 2


def test_a_retreat_never_returns_to_a_reference_before_the_activation() -> None:
    arm = Moving(Reaction.RETREAT)
    arm.run(1.0)
    arm.loop.release()
    arm.q, arm.dq = GOAL, np.zeros(4)
    arm.run(0.005)
    arm.go(START)
    arm.run(0.1)
    arm.run(1.0, contact=True)
    assert np.linalg.norm(arm.q - GOAL) < 0.02


def test_a_reaction_lasts_as_long_as_its_contact_and_a_silent_estimator_ends_it() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(0.5)
    arm.run(0.1, contact=True)
    arm.reaction.reaction = Reaction.REPORT
    arm.run(0.1, contact=True)
    assert arm.loop.touched
    assert not arm.reaction.is_silent(arm.now + 0.4)
    assert arm.reaction.is_silent(arm.now + 0.6)
    arm.reaction.update(arm.q, arm.now + 0.6)
    assert not arm.reaction.in_contact
    arm.run(0.01, contact=True)
    assert not arm.loop.touched
