"""Meshes have the size of their shapes."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from aerarm_ros.excitation.preview import mesh_of_shape

PLACEMENT = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.5, 0.9), np.array([0.1, 0.2, 0.3]))


@pytest.mark.parametrize(
    ('shape', 'volume'),
    [
        (pin.hppfcl.Box(0.1, 0.2, 0.3), 0.006),
        (pin.hppfcl.Cylinder(0.1, 0.5), np.pi * 0.01 * 0.5),
        (pin.hppfcl.Sphere(0.1), 4.0 / 3.0 * np.pi * 0.001),
        (pin.hppfcl.Capsule(0.1, 0.5), np.pi * 0.01 * 0.5 + 4.0 / 3.0 * np.pi * 0.001),
    ],
)
def test_volume_and_place(shape, volume: float) -> None:
    mesh = mesh_of_shape(pin.GeometryObject('shape', 0, 0, PLACEMENT, shape))
    # Sixteen segments a turn, inside the shape: up to a tenth is missing from round ones.
    assert 0.85 * volume < ConvexHull(mesh.vertices).volume <= volume * (1.0 + 1e-9)
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), PLACEMENT.translation, atol=1e-9)
    assert mesh.triangles.max() == len(mesh.vertices) - 1


def test_a_scanned_hull_is_drawn_with_few_corners() -> None:
    ball = np.random.default_rng(0).normal(size=(5000, 3))
    ball *= 0.1 / np.linalg.norm(ball, axis=1, keepdims=True)
    points = pin.hppfcl.StdVec_Vec3s()
    for point in ball:
        points.append(point)
    hull = pin.hppfcl.Convex.convexHull(points, True, None)
    mesh = mesh_of_shape(pin.GeometryObject('scan', 0, 0, PLACEMENT, hull))
    assert len(mesh.vertices) <= 96
    whole = 4.0 / 3.0 * np.pi * 0.001
    assert 0.85 * whole < ConvexHull(mesh.vertices).volume < whole


def test_a_plane_has_no_mesh() -> None:
    plane = pin.hppfcl.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    assert mesh_of_shape(pin.GeometryObject('ground', 0, 0, PLACEMENT, plane)) is None
