"""Activation, gaps, missing numbers, compensation and limits around a law."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.control.laws.gravity_compensation import GravityCompensation
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.motion.signals import ArmState, JointCommand

CYCLE = 1e-3
POSTURE = np.array([0.2, 1.0, -0.3, 0.5])
REST = ArmState(POSTURE, np.zeros(4), np.zeros(4))


@pytest.fixture
def follower(limits) -> TrajectoryFollower:
    return TrajectoryFollower(limits, FollowerTolerances.uniform(4, path=2.0))


@pytest.fixture
def loop(limits, follower, dynamics) -> ControlLoop:
    return ControlLoop(limits, follower, ComputedTorque(dynamics, 100.0, 20.0))


def test_control_starts_at_the_measured_posture_also_after_a_gap_and_a_release(
    loop, dynamics
) -> None:
    assert loop.update(REST, 5.0) is None
    command = loop.update(REST, 5.0 + CYCLE)
    np.testing.assert_allclose(command.tau, dynamics.fixed.gravity(POSTURE), atol=1e-9)
    for now in (5.5, 5.501):
        loop.update(REST, now)
    assert loop.take_overs == 2
    loop.release()
    for now in (5.502, 5.503):
        loop.update(REST._replace(q=POSTURE + 0.3), now)
    np.testing.assert_allclose(loop.source.reference.q, POSTURE + 0.3)


def test_no_command_without_numbers_or_with_an_old_stamp_and_none_beyond_the_limits(
    loop, limits
) -> None:
    loop.update(REST, 0.0)
    assert loop.update(REST._replace(dq=np.array([0.0, np.nan, 0.0, 0.0])), 0.001) is None
    assert loop.update(REST, 0.001) is not None
    assert loop.update(REST, 0.001) is None
    assert loop.update(REST, 0.0005) is None
    assert loop.skipped == 3
    command = loop.update(REST._replace(q=POSTURE + 1.5), 0.002)
    assert np.all(np.abs(command.tau) <= limits.effort_max)
    assert np.any(np.abs(command.tau) == limits.effort_max)


def test_compensation_removes_the_error_caused_by_a_constant_force(
    limits, dynamics, frictionless_bench
) -> None:
    errors = []
    for compensation in (0.0, 2.0):
        follower = TrajectoryFollower(limits, FollowerTolerances.uniform(4))
        loop = ControlLoop(
            limits,
            follower,
            ComputedTorque(dynamics, 100.0, 20.0),
            MomentumObserver(dynamics, 40.0),
            compensation_max=compensation,
        )
        arm = frictionless_bench(POSTURE)
        hold = JointCommand(tau=dynamics.fixed.gravity(POSTURE))
        force = np.array([0.3, 0.4, 0.1, 0.1])
        run = arm.run(lambda s, now: loop.update(s, now) or hold, 1.0, disturbance=force)  # noqa: B023
        errors.append(np.abs(run.q[-1] - POSTURE))
        np.testing.assert_allclose(loop.disturbance, force, atol=0.01)
    assert np.all(errors[1] < 0.02 * errors[0])


def test_settles_within_5_mrad_of_any_set_point(limits, dynamics, bench, config, postures) -> None:
    """With the drives' friction, standing and hanging, in the plant's exact gravity."""
    viscous, coulomb = config.column('viscous'), config.column('coulomb')
    friction = FrictionCompensation(viscous, coulomb)
    for index, goal in enumerate(postures[:6]):
        gravity = np.array([0.0, 0.0, -9.81 if index % 2 else 9.81])
        follower = TrajectoryFollower(limits, FollowerTolerances.uniform(4, path=1.0))
        loop = ControlLoop(
            limits,
            follower,
            GravityCompensation(dynamics, [60, 60, 40, 40], [5, 5, 1, 1], friction),
            MomentumObserver(dynamics, 10.0, friction),
            BaseMotionEstimator(gravity, 'none'),
            compensation_max=1.0,
        )
        arm = bench(postures[index + 1])
        arm.plant.gravity_in_base = gravity

        def controller(state, now):
            if now == 2 * CYCLE:
                follower.go_to(goal, now)  # noqa: B023
            return loop.update(state, now) or JointCommand(tau=state.tau)  # noqa: B023

        run = arm.run(controller, 4.0)
        assert np.abs(run.q[-1] - goal).max() < 5e-3
        assert np.abs(run.dq[-1]).max() < 1e-2


def test_a_turning_base_is_no_disturbance(limits, follower, dynamics) -> None:
    """The observer uses the base's motion at the time of the torque, not of the command."""
    gravity, rate = np.array([0.0, 0.0, -9.81]), np.array([3.0, 0.0, 0.0])
    estimator = BaseMotionEstimator(gravity, 'full')
    observer = MomentumObserver(dynamics, 40.0)
    law = ComputedTorque(dynamics, 100.0, 20.0)
    loop = ControlLoop(limits, follower, law, observer, estimator)

    def felt(time: float) -> BaseMotion:
        turn = Rotation.from_rotvec(rate * time).inv()
        return BaseMotion(turn.apply(gravity), -turn.apply(gravity), rate, np.zeros(3))

    for cycle in range(300):
        now = cycle * CYCLE
        if cycle % 4 == 0:
            base = felt(now)
            estimator.offer(ImuSample(now, None, rate, base.specific_force), now)
        # Held at rest by exactly what the base asks for in the middle of the cycle.
        tau = dynamics.gravity(POSTURE, felt(now - 0.5 * CYCLE))
        loop.update(REST._replace(tau=tau), now)
        loop.observe()
    swing = np.abs(dynamics.gravity(POSTURE, felt(0.3)) - dynamics.gravity(POSTURE, felt(0.0)))
    assert swing.max() > 0.5
    assert np.abs(loop.disturbance).max() < 1e-3 * swing.max()
