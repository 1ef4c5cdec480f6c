"""Kinematics: DH table 2.1 against the URDF, Jacobians against finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.kinematics import (
    ARM_LENGTH,
    DH_BASE_HEIGHT,
    Kinematics,
    dh_forward,
    dh_transform,
)

UPRIGHT = np.array([0.3, np.pi / 2, -0.4, 0.0])


def last_frame(robot: Robot) -> str:
    return str(robot.link_names[-1])


def test_a_dh_transform_is_its_four_elementary_motions() -> None:
    a, d, alpha, theta = 0.3, -0.2, 0.7, -1.1
    screws = []
    for axis, length, angle in (('z', d, theta), ('x', a, alpha)):
        motion = np.eye(4)
        motion[:3, :3] = Rotation.from_euler(axis, angle).as_matrix()
        motion[:3, 3] = length * (np.array(list('xyz')) == axis)
        screws.append(motion)
    assert np.allclose(dh_transform(a, d, alpha, theta), screws[0] @ screws[1])


def test_urdf_and_dh_table_agree_on_the_wrist(arm: Robot, rng: np.random.Generator) -> None:
    kinematics = Kinematics(arm, 'wrist')
    for q in rng.uniform(-np.pi, np.pi, (50, 4)):
        expected = dh_forward(q)
        expected[2, 3] += DH_BASE_HEIGHT
        assert np.allclose(kinematics.transform(q), expected, atol=1e-14)


def test_the_wrist_stays_on_a_sphere_about_joint_2(arm: Robot, rng: np.random.Generator) -> None:
    shoulder = np.array([0.0, 0.0, DH_BASE_HEIGHT])
    wrist = Kinematics(arm, 'wrist')
    for q in rng.uniform(-np.pi, np.pi, (20, 4)):
        assert np.linalg.norm(wrist.position(q) - shoulder) == pytest.approx(ARM_LENGTH)
        assert np.linalg.matrix_rank(wrist.position_jacobian(q), tol=1e-9) <= 2


def test_the_tool_point_can_move_in_three_directions(arm: Robot) -> None:
    q = np.array([0.1, 0.8, 0.4, 0.9])
    assert np.linalg.matrix_rank(Kinematics(arm, 'tool0').position_jacobian(q), tol=1e-3) == 3


def test_the_arm_is_straight_at_zero_and_upright_with_joint_2_at_90_degrees(arm: Robot) -> None:
    reach = ARM_LENGTH + 0.10
    tool = Kinematics(arm)
    assert np.allclose(tool.position(np.zeros(4)), [reach, 0.0, DH_BASE_HEIGHT])
    assert np.allclose(tool.position(UPRIGHT), [0.0, 0.0, DH_BASE_HEIGHT + reach])


def test_the_upright_posture_is_farthest_from_the_ground(
    arm: Robot, rng: np.random.Generator
) -> None:
    tool = Kinematics(arm)
    height = tool.position(UPRIGHT)[2]
    postures = rng.uniform(arm.position_min, arm.position_max, (200, 4))
    assert max(tool.position(q)[2] for q in postures) < height


def test_jacobian_is_the_derivative_of_the_pose(robot: Robot, rng: np.random.Generator) -> None:
    kinematics = Kinematics(robot, last_frame(robot))
    step = 1e-6
    for q in rng.uniform(-1.5, 1.5, (5, robot.n)):
        jacobian = kinematics.jacobian(q)
        assert np.allclose(jacobian[:3], kinematics.position_jacobian(q))
        for i, unit in enumerate(np.eye(robot.n)):
            ahead, behind = (kinematics.transform(q + s * step * unit) for s in (1, -1))
            linear = (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
            angular = pin.log3(ahead[:3, :3] @ behind[:3, :3].T) / (2 * step)
            assert np.allclose(jacobian[:, i], [*linear, *angular], atol=1e-8)


def test_results_are_not_overwritten_by_the_next_call(arm: Robot) -> None:
    tool = Kinematics(arm)
    first = tool.transform(np.zeros(4)), tool.position(np.zeros(4)), tool.jacobian(np.zeros(4))
    kept = [value.copy() for value in first]
    tool.transform(UPRIGHT), tool.jacobian(UPRIGHT)
    for value, copy in zip(first, kept, strict=True):
        assert np.array_equal(value, copy)


def test_an_unknown_frame_is_refused_with_the_known_ones(arm: Robot) -> None:
    with pytest.raises(ValueError, match=r"unknown link 'tool1'.*tool0"):
        Kinematics(arm, 'tool1')


def test_dh_needs_four_angles() -> None:
    with pytest.raises(ValueError):
        dh_forward(np.zeros(3))
