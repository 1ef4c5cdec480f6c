"""Autopilot frames: known attitudes, and agreement with rotation matrices."""

import numpy as np
from scipy.spatial.transform import Rotation

from aerarm_ros.control.base.base_motion import (
    attitude_ned_frd_to_enu_flu,
    frd_to_flu,
    quaternion,
    rotation_matrix,
)

IDENTITY = [0.0, 0.0, 0.0, 1.0]


def ned_to_enu(vector: np.ndarray) -> np.ndarray:
    x, y, z = vector
    return np.array([y, x, -z])


def test_body_vectors() -> None:
    np.testing.assert_array_equal(frd_to_flu([1.0, 2.0, 3.0]), [1.0, -2.0, -3.0])
    # A level body at rest feels its support upward: -g along down, +g along up.
    np.testing.assert_allclose(frd_to_flu([0.0, 0.0, -9.81]), [0.0, 0.0, 9.81])


def test_a_level_body_facing_north_faces_the_enu_y_axis() -> None:
    rotation = rotation_matrix(attitude_ned_frd_to_enu_flu(IDENTITY))
    np.testing.assert_allclose(rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(rotation @ [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], atol=1e-12)


def test_a_vector_means_the_same_in_both_conventions() -> None:
    random = np.random.default_rng(0)
    for _ in range(20):
        attitude = Rotation.random(random_state=random)
        in_frd = random.normal(size=3)
        converted = rotation_matrix(attitude_ned_frd_to_enu_flu(attitude.as_quat()))
        np.testing.assert_allclose(
            converted @ frd_to_flu(in_frd), ned_to_enu(attitude.apply(in_frd)), atol=1e-12
        )


def test_rotation_matrix_agrees_with_scipy() -> None:
    attitude = Rotation.random(random_state=1)
    np.testing.assert_allclose(rotation_matrix(attitude.as_quat()), attitude.as_matrix())
    back = rotation_matrix(quaternion(attitude.as_matrix()))
    np.testing.assert_allclose(back, attitude.as_matrix())
