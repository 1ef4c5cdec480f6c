"""Collision shapes of an arm, and which pairs of them can meet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.excitation_error import ExcitationError
from aerarm_ros.excitation.joint_reference import FloatArray

GROUND = 'ground'
_SAMPLES = 300
_ALWAYS = 0.95  # share of random postures, as MoveIt's setup assistant
_CONSTANT = 1e-5  # [m]


def build_collision_geometry(
    robot: Robot,
    ground_height: float | None,
    clearance: tuple[float, float],
    package_directories: Sequence[Path] = (),
) -> tuple[pin.GeometryModel, FloatArray]:
    """Return the pairs that a motion has to keep apart, and how far.

    Meshes become their convex hulls. Links joined by one joint are not a pair: they touch by
    construction. Neither are shapes that overlap in (nearly) every posture, or whose distance
    never changes, such as the column that turns on the base and the ground below it. Links that
    are built close together cannot keep more than they have: a pair has to keep the required
    clearance, or half of its median distance over random postures if that is less.

    Parameters
    ----------
    robot : arm, with collision shapes in its URDF; shapes fixed to the base (a drone's body,
        its landing gear) are obstacles.
    ground_height : height of the ground plane along the direction opposite to gravity, from
        the base frame's origin [m]; None if there is no ground below the arm.
    clearance : required distances [m], (arm to itself, arm to ground).
    package_directories : where `package://` meshes are looked for, besides the folders above
        the URDF.

    Returns
    -------
    geometry : Pinocchio's geometry model.
    required : (pairs,) required distance of each pair [m].

    Raises
    ------
    ExcitationError
        If the URDF has no collision shape on a moving link, or a mesh cannot be read.
    """
    geometry = _read_shapes(robot, package_directories)
    if ground_height is not None:
        geometry.addGeometryObject(_ground(robot, ground_height))
    _add_pairs(robot.model, geometry)
    typical = _keep_meaningful_pairs(robot, geometry)
    own, ground = clearance
    wanted = [ground if touches_ground(geometry, pair) else own for pair in geometry.collisionPairs]
    return geometry, np.maximum(np.minimum(wanted, 0.5 * typical), 0.0)


def _read_shapes(robot: Robot, package_directories: Sequence[Path]) -> pin.GeometryModel:
    folders = [str(folder) for folder in package_directories]
    if robot.path is not None:
        folders += [str(folder) for folder in Path(robot.path).resolve().parents]
    try:
        geometry = pin.buildGeomFromUrdfString(
            robot.model, robot.urdf_text, pin.GeometryType.COLLISION, package_dirs=folders
        )
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


def _add_pairs(model: pin.Model, geometry: pin.GeometryModel) -> None:
    shapes = geometry.geometryObjects
    for b, second in enumerate(shapes):
        for a, first in enumerate(shapes[:b]):
            joints = {first.parentJoint, second.parentJoint}
            low, high = min(joints), max(joints)
            moving = low != high
            neighbours = moving and model.parents[high] == low
            if moving and (not neighbours or GROUND in (first.name, second.name)):
                geometry.addCollisionPair(pin.CollisionPair(a, b))


def _keep_meaningful_pairs(robot: Robot, geometry: pin.GeometryModel) -> FloatArray:
    """Drop pairs that nearly always overlap or never change; return the others' median distance."""
    data, geometry_data = robot.model.createData(), pin.GeometryData(geometry)
    distance = np.empty((_SAMPLES, len(geometry.collisionPairs)))
    for row, q in enumerate(_random_postures(robot)):
        pin.computeDistances(robot.model, data, geometry, geometry_data, q)
        distance[row] = [result.min_distance for result in geometry_data.distanceResults]
    overlap = (distance < 0.0).mean(axis=0)
    dropped = (overlap > _ALWAYS) | (np.ptp(distance, axis=0) < _CONSTANT)
    # Copies: removing a pair moves the ones behind it under any reference held to them.
    kept = [
        pin.CollisionPair(pair.first, pair.second)
        for pair, drop in zip(geometry.collisionPairs, dropped, strict=True)
        if not drop
    ]
    geometry.removeAllCollisionPairs()
    for pair in kept:
        geometry.addCollisionPair(pair)
    return np.asarray(np.median(distance[:, ~dropped], axis=0))


def _random_postures(robot: Robot) -> FloatArray:
    low = np.maximum(robot.position_min, -np.pi)
    high = np.minimum(robot.position_max, np.pi)
    return np.random.default_rng(0).uniform(low, high, (_SAMPLES, robot.n))


def touches_ground(geometry: pin.GeometryModel, pair: pin.CollisionPair) -> bool:
    """Return whether one of the pair is the ground."""
    shapes = geometry.geometryObjects
    return GROUND in (shapes[pair.first].name, shapes[pair.second].name)


def motion_bounds(model: pin.Model, geometry: pin.GeometryModel) -> FloatArray:
    """Return how far each joint can change each pair's distance, (pairs, n) [m/rad].

    The distance of two bodies is 1-Lipschitz in their relative motion, and turning joint j by
    one radian moves no point of a body further than the point's distance from the joint's axis.
    That distance is at most the sum of the offsets along the chain and the body's radius. For a
    prismatic joint the bound is 1.
    """
    bounds = np.zeros((len(geometry.collisionPairs), model.nv))
    for row, pair in enumerate(geometry.collisionPairs):
        for index in (pair.first, pair.second):
            shape = geometry.geometryObjects[index]
            other = geometry.geometryObjects[pair.second if index == pair.first else pair.first]
            bounds[row] += _reach(model, shape, list(model.supports[other.parentJoint]))
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
