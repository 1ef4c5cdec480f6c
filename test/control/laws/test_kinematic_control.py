"""Kinematic control, thesis 2.5.2 and 2.5.3, on joints that follow velocities (2.5.1)."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.control.laws.kinematic_control import (
    CartesianMotionControl,
    DampedInverse,
    JointMotionControl,
    VelocityResolution,
)
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState, TaskReference

CYCLE = 1e-3
REST = np.array([0.0, 1.5708, 0.0, 0.0])
START = np.array([0.3, 1.1, 0.4, 0.9])


@pytest.fixture
def make_resolution(robot, limits) -> Callable[..., VelocityResolution]:
    def make(frame='tool0', rest=REST, **options):
        return VelocityResolution(
            Kinematics(robot, frame), limits, rest, DampedInverse(), **options
        )

    return make


def integrate(law, reference, start, seconds):
    """Return joint positions (M + 1, n) of joints that follow their velocity at once."""
    rows = [np.array(start)]
    law.take_over(rows[0])
    for cycle in range(round(seconds / CYCLE)):
        state = ArmState(rows[-1], np.zeros(4), np.zeros(4))
        command = law.update(state, reference(cycle * CYCLE), CYCLE)
        assert command.tau is None
        rows.append(rows[-1] + CYCLE * command.dq)
    return np.array(rows)


def circle(centre, radius=0.05, rate=2.0):
    def reference(now):
        s, c = np.sin(rate * now), np.cos(rate * now)
        return TaskReference(
            centre + radius * np.array([0.0, s, c - 1.0]),
            radius * rate * np.array([0.0, c, -s]),
            -radius * rate**2 * np.array([0.0, s, c]),
        )

    return reference


def still(p):
    return lambda now: TaskReference(np.array(p), np.zeros(3), np.zeros(3))


def test_cartesian_error_decays_exponentially(make_resolution) -> None:
    resolution = make_resolution()
    goal = resolution.kinematics.position(START) + [0.03, -0.04, 0.02]
    law = CartesianMotionControl(resolution, 5.0)
    rows = integrate(law, still(goal), START, 1.0)
    error = np.array([goal - resolution.kinematics.position(q) for q in rows])
    predicted = np.outer(np.exp(-5.0 * CYCLE * np.arange(len(rows))), error[0])
    np.testing.assert_allclose(error, predicted, atol=2e-4)


def test_joint_error_decays_exponentially(make_resolution) -> None:
    resolution = make_resolution(rest_gain=0.0)
    law = JointMotionControl(resolution, 8.0)
    goal = resolution.kinematics.position(START)
    law.take_over(START)
    offset = np.array([0.1, -0.1, 0.05, 0.1])
    q, errors = START - offset, []
    for _ in range(500):
        velocity = law.update(ArmState(q, q, q), still(goal)(0.0), CYCLE).dq
        errors.append(law.qd - q)
        q = q + CYCLE * velocity
    predicted = np.outer(np.exp(-8.0 * CYCLE * np.arange(500)), offset)
    np.testing.assert_allclose(errors, predicted, atol=1e-3)


@pytest.mark.parametrize('kind', [JointMotionControl, CartesianMotionControl])
def test_a_circle_is_followed(make_resolution, kind) -> None:
    resolution = make_resolution()
    centre = resolution.kinematics.position(START)
    reference = circle(centre)
    rows = integrate(kind(resolution, 10.0), reference, START, 4.0)
    errors = [
        reference(CYCLE * i).p - resolution.kinematics.position(q) for i, q in enumerate(rows)
    ]
    assert np.abs(errors[500:]).max() < 5e-4


def test_the_null_space_goes_to_rest_without_moving_the_tool(make_resolution) -> None:
    resolution = make_resolution(rest_gain=2.0)
    goal = resolution.kinematics.position(START)
    rows = integrate(CartesianMotionControl(resolution, 10.0), still(goal), START, 3.0)
    moved = [np.linalg.norm(resolution.kinematics.position(q) - goal) for q in rows]
    assert max(moved) < 1e-3
    assert np.linalg.norm(rows[-1] - REST) < np.linalg.norm(START - REST) - 0.02


def test_limits_are_never_passed(make_resolution, limits) -> None:
    resolution = make_resolution(limit_gain=10.0)
    # Beyond what joint 2 allows, and beyond reach.
    for goal in ([0.3, 0.0, -0.7], [-0.6, 0.1, -0.4], [3.0, 0.0, 0.0]):
        rows = integrate(CartesianMotionControl(resolution, 5.0), still(goal), START, 4.0)
        assert np.all(rows >= limits.position_min)
        assert np.all(rows <= limits.position_max)
        assert np.abs(np.diff(rows, axis=0)).max() <= CYCLE * limits.velocity_max.max() + 1e-9


def test_other_joints_move_the_tool_if_one_is_at_its_limit(make_resolution, limits) -> None:
    resolution = make_resolution(rest_gain=0.0, margin=0.02)
    # Joint 3, not 4: only joint 4 changes the tool's distance from joint 2.
    q = np.array([0.3, 1.1, limits.position_max[2] - 0.02, 0.9])
    jacobian = resolution.kinematics.position_jacobian(q)
    velocity = jacobian @ np.array([0.1, 0.2, 0.8, 0.4])
    dq = resolution.resolve(q, velocity)
    assert dq[2] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(jacobian @ dq, velocity, atol=1e-6)


def test_too_fast_a_tool_is_slowed_down_in_its_direction(make_resolution, limits) -> None:
    resolution = make_resolution(rest_gain=0.0, limit_gain=1e3)
    velocity = np.array([0.0, 20.0, 5.0])
    dq = resolution.resolve(START, velocity)
    assert np.abs(dq).max() == pytest.approx(limits.velocity_max.max(), rel=1e-6)
    got = resolution.kinematics.position_jacobian(START) @ dq
    np.testing.assert_allclose(got, resolution.slowdown * velocity, atol=1e-6)
    assert resolution.slowdown < 1.0


def test_equals_the_pseudo_inverse_away_from_singularities(robot, postures) -> None:
    kinematics = Kinematics(robot, 'tool0')
    inverse = DampedInverse(threshold=0.01, damping=0.01)
    tried = 0
    for q in postures:
        jacobian = kinematics.position_jacobian(q)
        result = inverse.of(jacobian)
        if result.least > 0.01:
            tried += 1
            np.testing.assert_allclose(result.inverse, np.linalg.pinv(jacobian), atol=1e-9)
            np.testing.assert_allclose(jacobian @ result.null_space, 0.0, atol=1e-9)
    assert tried >= 5


def test_is_bounded_at_the_wrist_which_is_singular_everywhere(robot, postures) -> None:
    kinematics = Kinematics(robot, 'wrist')
    inverse = DampedInverse(threshold=0.08, damping=0.04)
    for q in postures:
        jacobian = kinematics.position_jacobian(q)
        result = inverse.of(jacobian)
        assert result.least < 1e-9
        assert np.linalg.norm(result.inverse, 2) < 1.0 / (2.0 * 0.04) + 1.0 / 0.08
        # What the wrist can do it still does exactly.
        reachable = jacobian @ np.array([0.3, -0.2, 0.0, 0.0])
        if np.linalg.svd(jacobian)[1][1] > 0.08:
            np.testing.assert_allclose(jacobian @ result.inverse @ reachable, reachable, atol=1e-9)


def test_the_singular_wrist_is_controlled_with_bounded_velocities(make_resolution) -> None:
    resolution = make_resolution('wrist', rest_gain=3.0)
    start = resolution.kinematics.position(START)
    # The wrist stays on a sphere about joint 2: a goal off it is approached, not reached.
    goal = 1.1 * start + [0.0, 0.05, 0.0]
    rows = integrate(CartesianMotionControl(resolution, 5.0), still(goal), START, 3.0)
    assert np.abs(np.diff(rows, axis=0)).max() / CYCLE < 3.0
    assert np.abs(np.diff(rows[-100:], axis=0)).max() < 1e-5
    end = resolution.kinematics.position(rows[-1])
    assert np.linalg.norm(goal - end) < np.linalg.norm(goal - start)
