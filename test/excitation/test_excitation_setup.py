"""Random trajectories and whole motions inside the limits, in this and in another process."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.excitation.excitation_setup import (
    EXCITATION,
    ExcitationPlanner,
    ExcitationSetup,
    RandomTrajectory,
)
from aerarm_ros.excitation.feasibility import FeasibilityChecker
from aerarm_ros.excitation.settings import (
    ExcitationConfig,
    ExcitationError,
    InfeasibleError,
    MotionLimits,
)
from aerarm_ros.excitation.trajectory import FourierTrajectory, MotionSequence
from aerarm_ros.motion.signals import JointMotion

RAMP = 2.0


@pytest.fixture(scope='module')
def transfer_checker(checker: FeasibilityChecker, arm: ArmConfig) -> FeasibilityChecker:
    return FeasibilityChecker(MotionLimits.of_arm(arm), checker.clearance, checker.effort_model)


@pytest.fixture(scope='module')
def planner(setup: ExcitationSetup) -> ExcitationPlanner:
    return setup.planner


@pytest.fixture(scope='module')
def plan(planner: ExcitationPlanner, trajectory: FourierTrajectory) -> MotionSequence:
    return planner.plan(trajectory, 2, np.array([0.5, 1.0, -0.5, 0.3]))


def test_a_plan_starts_and_ends_at_rest_and_is_continuous_within_the_limits(
    plan: MotionSequence, transfer_checker: FeasibilityChecker
) -> None:
    time = np.linspace(0.0, plan.duration, 60001)
    reference = plan.evaluate(time)
    for end in (0, -1):
        np.testing.assert_allclose(reference.q[end], [0.5, 1.0, -0.5, 0.3], atol=1e-12)
        np.testing.assert_allclose(reference.dq[end], 0.0, atol=1e-12)
    numeric = np.gradient(reference.q, time, axis=0)
    np.testing.assert_allclose(numeric[1:-1], reference.dq[1:-1], atol=1e-4)
    assert np.abs(np.diff(reference.ddq, axis=0)).max() < 0.05
    assert transfer_checker.check(plan).feasible


def test_the_transfer_avoids_a_collision_on_the_straight_path(
    planner: ExcitationPlanner, trajectory: FourierTrajectory, transfer_checker: FeasibilityChecker
) -> None:
    # Folded over on the far side: the way down is blocked by the ground unless it goes back up.
    start = np.array([0.0, 3.0, 0.0, 0.9])
    plan = planner.plan(trajectory, 1, start)
    assert transfer_checker.check(plan).feasible


def test_an_infeasible_start_or_trajectory_is_named(
    planner: ExcitationPlanner, trajectory: FourierTrajectory
) -> None:
    with pytest.raises(InfeasibleError, match='start posture is infeasible: ground clearance'):
        planner.plan(trajectory, 1, np.array([0.0, -0.4, 0.0, 0.0]))
    with pytest.raises(InfeasibleError, match='start posture is infeasible: position of joint4'):
        planner.plan(trajectory, 1, np.array([0.0, 1.5, 0.0, 2.2]))
    wild = FourierTrajectory(0.1, np.array([0.0, 1.5, 0.0, 0.0]), *np.full((2, 4, 5), 0.7))
    with pytest.raises(InfeasibleError, match='the trajectory is infeasible: '):
        planner.plan(wild, 1, np.array([0.0, 1.5, 0.0, 0.0]))


def test_a_slowed_trajectory_keeps_its_shape(
    planner: ExcitationPlanner, trajectory: FourierTrajectory
) -> None:
    """The factor applies until the motion with its ramps is slow enough."""
    fastest = 0.8 * np.abs(trajectory.evaluate(np.linspace(0.0, 10.0, 500)).dq).max()

    def slowdown(motion: JointMotion) -> float:
        speed = np.abs(motion.evaluate(np.linspace(0.0, motion.duration, 2000)).dq).max()
        return max(1.0, float(speed) / fastest)

    slowed = planner.slowed(trajectory, 2, slowdown)
    assert slowed.period == pytest.approx(1.25 * trajectory.period, rel=1e-2)
    times = np.linspace(0.0, trajectory.period, 50)
    np.testing.assert_allclose(
        slowed.evaluate(times * slowed.period / trajectory.period).q,
        trajectory.evaluate(times).q,
        atol=1e-12,
    )
    start = np.array([0.5, 1.0, -0.5, 0.3])
    full, half = (
        planner.plan(slowed, 2, start, slowdown=lambda _, factor=factor: factor)
        for factor in (1.0, 2.0)
    )
    durations = np.diff(full.boundaries)
    names = np.array([stage.name for stage in full.stages])
    twice = np.where(names == EXCITATION, durations, 2.0 * durations)
    np.testing.assert_allclose(np.diff(half.boundaries), twice)


@pytest.mark.parametrize(
    ('change', 'limit'),
    [
        ({'amplitude': 3.0}, 'velocity|position|torque'),
        ({'fundamental': 0.35}, 'acceleration|velocity|torque'),
        ({'fundamental': 1.0}, 'frequency of highest harmonic'),
        ({'bias': np.array([0.0, -0.4, 0.0, 0.0])}, 'position of joint2|ground clearance'),
    ],
)
def test_infeasible_limits_name_the_one_that_binds(
    candidates: RandomTrajectory, checker: FeasibilityChecker, change: dict, limit: str
) -> None:
    with pytest.raises(InfeasibleError, match=limit) as caught:
        replace(candidates, **change).draw_feasible(0, checker, RAMP, attempts=10)
    assert 'exceeds its limit in' in str(caught.value)


def test_wrong_numbers_are_named(robot) -> None:
    config = ExcitationConfig()
    setup = ExcitationSetup.of_robot(robot, config, (), [1.0, 2.0, 3.0, 4.0])
    np.testing.assert_array_equal(setup.limits.acceleration, [1.0, 2.0, 3.0, 4.0])
    for change in ({'amplitude': 0.0}, {'harmonics': 0}, {'fundamental': np.nan}):
        with pytest.raises(ExcitationError):
            RandomTrajectory(np.zeros(4), **change)
    for wrong, message in (
        ([1.0, 2.0], 'acceleration limit must have 1 value or 4'),
        (-1.0, 'acceleration of joint1 must be positive'),
    ):
        with pytest.raises(ExcitationError, match=message):
            ExcitationSetup.of_robot(robot, config, (), wrong)
