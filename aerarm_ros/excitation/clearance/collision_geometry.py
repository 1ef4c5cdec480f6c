"""Collision shapes of an arm and of what surrounds it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerarm_ros.description.description_error import DescriptionError
from aerarm_ros.description.robot import Robot
from aerarm_ros.description.robot_shapes import load_shapes
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray

GROUND = 'ground'


def build_collision_geometry(
    robot: Robot, ground_height: float | None, package_directories: Sequence[Path] = ()
) -> pin.GeometryModel:
    """Return the shapes of an arm and its surroundings, without pairs.

    Meshes become their convex hulls.

    Parameters
    ----------
    robot : arm, with collision shapes in its URDF; shapes fixed to the base (a drone's body,
        its landing gear) are obstacles.
    ground_height : height of the ground plane along the direction opposite to gravity, from
        the base frame's origin [m]; None if there is no ground below the arm.
    package_directories : where `package://` meshes are looked for, besides the folders above
        the URDF.

    Raises
    ------
    ExcitationError
        If the URDF has no collision shape on a moving link, or a mesh cannot be read or
        is larger than an arm needs.
    """
    geometry = _read_shapes(robot, package_directories)
    if ground_height is not None:
        geometry.addGeometryObject(_ground(robot, ground_height))
    return geometry


def _read_shapes(robot: Robot, package_directories: Sequence[Path]) -> pin.GeometryModel:
    try:
        geometry = load_shapes(robot, pin.GeometryType.COLLISION, package_directories)
    except DescriptionError as error:
        raise ExcitationError(str(error)) from error
    except (ValueError, RuntimeError) as error:
        raise ExcitationError(
            f'collision shapes cannot be read: {str(error).strip()}: check the mesh paths of the '
            'URDF, or give the package directory'
        ) from error
    if not any(shape.parentJoint > 0 for shape in geometry.geometryObjects):
        raise ExcitationError(
            'the URDF has no <collision> shape on a moving link, so clearance cannot be checked'
        )
    for shape in geometry.geometryObjects:
        if hasattr(shape.geometry, 'buildConvexHull'):
            shape.geometry.buildConvexHull(True, 'Qt')
            shape.geometry = shape.geometry.convex
    return geometry


def _ground(robot: Robot, height: float) -> pin.GeometryObject:
    gravity = np.asarray(robot.gravity_in_base, dtype=float)
    if not np.linalg.norm(gravity) > 0.0:
        raise ExcitationError('without gravity there is no ground: set the ground height to none')
    up = -gravity / np.linalg.norm(gravity)
    plane = pin.hppfcl.Halfspace(up, height)
    return pin.GeometryObject(GROUND, 0, 0, pin.SE3.Identity(), plane)


def touches_ground(geometry: pin.GeometryModel, pair: pin.CollisionPair) -> bool:
    """Return whether one of the pair is the ground."""
    shapes = geometry.geometryObjects
    return GROUND in (shapes[pair.first].name, shapes[pair.second].name)


def link_of(model: pin.Model, geometry: pin.GeometryModel, shape: int) -> str:
    """Return the link a shape belongs to; 'ground' for the ground."""
    found = geometry.geometryObjects[shape]
    fixed_to_nothing = found.parentJoint == 0 and found.parentFrame == 0
    return str(found.name if fixed_to_nothing else model.frames[found.parentFrame].name)


def motion_bounds(model: pin.Model, geometry: pin.GeometryModel) -> FloatArray:
    """Return how far each joint can change each pair's distance, (pairs, n) [m/rad].

    The distance of two bodies is 1-Lipschitz in their relative motion, and turning joint j by
    one radian moves no point of a body further than the point's distance from the joint's axis.
    That distance is at most the sum of the offsets along the chain and the body's radius. For a
    prismatic joint the bound is 1.

    Raises
    ------
    ExcitationError
        If a prismatic joint has no limits, so that nothing bounds the joints before it.
    """
    bounds = np.zeros((len(geometry.collisionPairs), model.nv))
    for row, pair in enumerate(geometry.collisionPairs):
        for index in (pair.first, pair.second):
            shape = geometry.geometryObjects[index]
            other = geometry.geometryObjects[pair.second if index == pair.first else pair.first]
            bounds[row] += _reach(model, shape, list(model.supports[other.parentJoint]))
    if not np.isfinite(bounds).all():
        raise ExcitationError(
            'a prismatic joint without position limits: how far the arm reaches is not known'
        )
    return bounds


def _reach(model: pin.Model, shape: pin.GeometryObject, shared: Sequence[int]) -> FloatArray:
    """Return the radius of `shape` about each joint that moves it but is not `shared`."""
    reach = np.zeros(model.nv)
    if shape.parentJoint == 0:
        return reach
    shape.geometry.computeLocalAABB()
    radius = float(np.linalg.norm(shape.placement.act(shape.geometry.aabb_center)))
    radius += float(shape.geometry.aabb_radius)
    joint = shape.parentJoint
    while joint > 0:
        # A prismatic joint's own travel lengthens the lever of the joints before it.
        prismatic = model.joints[joint].shortname().startswith('JointModelP')
        column = model.joints[joint].idx_v
        if joint not in shared:
            reach[column] = 1.0 if prismatic else radius
        if prismatic:
            limits = model.lowerPositionLimit[column], model.upperPositionLimit[column]
            radius += max(abs(limit) for limit in limits)
        radius += float(np.linalg.norm(model.jointPlacements[joint].translation))
        joint = model.parents[joint]
    return reach
