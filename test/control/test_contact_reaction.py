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


def test_report_changes_nothing() -> None:
    arm = Moving(Reaction.REPORT)
    arm.run(1.0)
    arm.run(1.2, contact=True)
    np.testing.assert_allclose(arm.q, GOAL, atol=1e-9)
    assert arm.reaction.count == 0


def test_stop_ends_on_the_path_as_fast_as_the_limits_allow() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(1.0)
    before = np.linalg.norm(arm.dq)
    arm.run(0.15, contact=True)
    assert before > 0.5
    assert np.linalg.norm(arm.dq) == 0.0
    assert distance_from_path(arm) < 1e-9
    assert arm.follower.outcome == 'stopped: contact (stop)'
    assert arm.reaction.count == 1


def test_retreat_goes_back_to_where_the_arm_was() -> None:
    arm = Moving(Reaction.RETREAT)
    arm.run(1.0)
    earlier = arm.past[-200]
    arm.run(1.0, contact=True)
    np.testing.assert_allclose(arm.q, earlier, atol=0.02)
    assert distance_from_path(arm) < 1e-3


def test_comply_lowers_the_stiffness_until_the_contact_has_ended() -> None:
    arm = Moving(Reaction.COMPLY)
    arm.run(1.0)
    arm.run(0.3, contact=True)
    assert arm.law.stiffness_share == pytest.approx(0.02)
    assert arm.reaction.complies
    pushed = arm.q = arm.q + 0.3
    arm.now += CYCLE
    arm.reaction.report(False, arm.now)
    arm.reaction.update(arm.q, arm.now)
    assert arm.reaction.complies
    arm.now += 0.6
    arm.reaction.update(arm.q, arm.now)
    assert not arm.reaction.complies
    np.testing.assert_allclose(arm.follower.reference.q, pushed)


def test_the_contact_is_no_disturbance_to_compensate() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(1.0)
    assert not arm.loop.touched
    arm.run(0.1, contact=True)
    assert arm.loop.touched
    arm.run(0.1)
    assert not arm.loop.touched


def test_an_arm_at_rest_does_not_retreat() -> None:
    arm = Moving(Reaction.RETREAT)
    arm.run(3.0)
    arm.run(1.0, contact=True)
    np.testing.assert_allclose(arm.q, GOAL, atol=1e-9)
    assert arm.reaction.count == 0


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


def test_a_stream_waits_for_the_end_of_the_contact_and_a_goal_does_not() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(1.0)
    arm.run(0.2, contact=True)
    with pytest.raises(RejectedInputError, match='something touches the arm'):
        arm.reaction.check_stream()
    arm.go(START)
    arm.run(2.5, contact=True)
    np.testing.assert_allclose(arm.q, START, atol=1e-9)
    arm.run(0.01)
    arm.reaction.check_stream()


def test_a_silent_estimator_reports_nothing() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(0.1, contact=True)
    assert not arm.reaction.is_silent(arm.now + 0.4)
    assert arm.reaction.is_silent(arm.now + 0.6)
    arm.reaction.update(arm.q, arm.now + 0.6)
    assert not arm.reaction.in_contact


def test_a_reaction_lasts_as_long_as_its_contact_even_if_another_is_set() -> None:
    arm = Moving(Reaction.STOP)
    arm.run(0.5)
    arm.run(0.1, contact=True)
    arm.reaction.reaction = Reaction.REPORT
    arm.run(0.1, contact=True)
    assert arm.loop.touched
    arm.run(0.01)
    assert not arm.loop.touched
    arm.run(0.01, contact=True)
    assert not arm.loop.touched


def test_a_contact_while_the_arm_brakes_makes_it_retreat() -> None:
    arm = Moving(Reaction.RETREAT)
    arm.run(1.0)
    arm.follower.stop(arm.now, 'stopped: request')
    arm.run(0.02)
    assert np.linalg.norm(arm.dq) > 0.1
    earlier = arm.past[-200]
    arm.run(1.0, contact=True)
    np.testing.assert_allclose(arm.q, earlier, atol=0.02)
    assert arm.reaction.count == 1
