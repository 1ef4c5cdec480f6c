"""Triangle meshes of collision shapes, for drawing."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import scipy
from numpy.typing import NDArray

from aerarm_ros.motion.float_array import FloatArray

_SEGMENTS = 16
_CORNERS = 96  # of a hull, at most


class TriangleMesh(NamedTuple):
    """Vertices (V, 3) [m] and triangles (T, 3) of vertex numbers."""

    vertices: FloatArray
    triangles: NDArray[np.intp]


def mesh_of_shape(shape: pin.GeometryObject) -> TriangleMesh | None:
    """Return the mesh of a convex shape in its link's joint frame, None if it has no points.

    Parameters
    ----------
    shape : box, cylinder, capsule, sphere or convex hull.
    """
    points = _points(shape.geometry)
    if points is None:
        return None
    hull = scipy.spatial.ConvexHull(points)
    used, triangles = np.unique(hull.simplices, return_inverse=True)
    placed = shape.placement
    vertices = points[used] @ placed.rotation.T + placed.translation
    return TriangleMesh(vertices, triangles.reshape(-1, 3))


def _points(geometry: Any) -> FloatArray | None:
    """Return points whose hull is the shape (round ones with a few segments), (P, 3)."""
    if hasattr(geometry, 'halfSide'):
        corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
        return np.asarray(corners * np.asarray(geometry.halfSide))
    if hasattr(geometry, 'points'):
        return _outermost(np.asarray(geometry.points()))
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    if hasattr(geometry, 'halfLength'):
        rounded = geometry.getNodeType() == pin.hppfcl.NODE_TYPE.GEOM_CAPSULE
        rings = _ball_rings() if rounded else [(1.0, 0.0)]
        half = geometry.halfLength
        parts: list[FloatArray] = [
            np.column_stack(
                [
                    geometry.radius * ring * circle,
                    np.full(len(circle), side * (half + geometry.radius * height)),
                ]
            )
            for side in (-1.0, 1.0)
            for ring, height in rings
        ]
        return np.concatenate(parts)
    if hasattr(geometry, 'radius'):
        parts = [
            np.column_stack([ring * circle, np.full(len(circle), side * height)])
            for side in (-1.0, 1.0)
            for ring, height in _ball_rings()
        ]
        return np.asarray(geometry.radius * np.concatenate(parts))
    return None


def _outermost(points: FloatArray) -> FloatArray:
    """Return those of (P, 3) points that lie farthest out in directions all around.

    A hull of a scanned shape has thousands of corners, and an animation holds each many times.
    """
    if len(points) <= _CORNERS:
        return points
    # Fibonacci's sphere: golden angles around, equal steps in height.
    height = 1.0 - (2.0 * np.arange(_CORNERS) + 1.0) / _CORNERS
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(_CORNERS)
    ring = np.sqrt(1.0 - height**2)
    directions = np.stack([ring * np.cos(angle), ring * np.sin(angle), height])
    return np.asarray(points[np.unique((points @ directions).argmax(axis=0))])


def _ball_rings() -> list[tuple[float, float]]:
    """Return radius and height of circles on the upper half of the unit ball."""
    latitudes = np.linspace(0.0, 0.5 * np.pi, 4)
    return [(max(float(np.cos(a)), 1e-3), float(np.sin(a))) for a in latitudes]
