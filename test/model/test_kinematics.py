"""Kinematics: DH table 2.1 against the URDF, Jacobians against finite differences."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.kinematics import Kinematics

ARM_LENGTH = 0.65  # [m] DH length d_3 of thesis table 2.1, from joint 2 to joint 4
DH_BASE_HEIGHT = 0.167  # [m] of the DH base frame above base_link, thesis A.4
DH_TABLE = (  # thesis table 2.1: a_i [m], d_i [m], alpha_i [rad], offset of theta_i [rad]
    (0.0, 0.0, np.pi / 2, 0.0),
    (0.0, 0.0, np.pi / 2, np.pi / 2),
    (0.0, ARM_LENGTH, np.pi / 2, 0.0),
    (0.0, 0.0, 0.0, 0.0),
)


def dh_forward(q: np.ndarray) -> np.ndarray:
    """Return T_4^0(q) of the thesis's DH table, the pose of the wrist in the DH base frame."""
    transform = np.eye(4)
    for (a, d, alpha, offset), angle in zip(DH_TABLE, q, strict=True):
        for axis, length, turn in (('z', d, angle + offset), ('x', a, alpha)):
            screw = np.eye(4)
            screw[:3, :3] = Rotation.from_euler(axis, turn).as_matrix()
            screw[:3, 3] = length * (np.array(list('xyz')) == axis)
            transform = transform @ screw
    return transform


def last_frame(robot: Robot) -> str:
    return str(robot.link_names[-1])


def test_urdf_and_dh_table_agree_on_the_wrist(arm: Robot, rng: np.random.Generator) -> None:
    kinematics = Kinematics(arm, 'wrist')
    for q in rng.uniform(-np.pi, np.pi, (50, 4)):
        expected = dh_forward(q)
        expected[2, 3] += DH_BASE_HEIGHT
        assert np.allclose(kinematics.transform(q), expected, atol=1e-14)


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


def test_an_unknown_frame_is_refused_with_the_known_ones(arm: Robot) -> None:
    with pytest.raises(ValueError, match=r"unknown link 'tool1'.*tool0"):
        Kinematics(arm, 'tool1')
