"""Distances between the arm's links, and between links and ground, along a motion."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerarm_ros.description.config_reader import DescriptionError
from aerarm_ros.description.robot import Robot
from aerarm_ros.description.robot_shapes import load_shapes
from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.motion.signals import Array

GROUND = 'ground'


def build_collision_geometry(
    robot: Robot, ground_height: float | None, package_directories: Sequence[Path] = ()
) -> pin.GeometryModel:
    """Return the collision shapes of an arm and its surroundings, without collision pairs.

    Meshes are replaced by their convex hulls.

    Parameters
    ----------
    robot : robot with collision shapes in its URDF; shapes fixed to the base, such as the body of
        a drone, are obstacles.
    ground_height : height of the ground plane above the base frame's origin, against gravity [m];
        None without ground below the arm.
    package_directories : folders for `package://` meshes, in addition to the folders above the
        URDF.

    Raises
    ------
    ExcitationError
        If no moving link has a collision shape in the URDF, or a mesh cannot be read or is too
        large.
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
            f'collision shapes cannot be read ({str(error).strip()}): check the mesh paths of '
            'the URDF, or pass the folder of its packages (package_directories, '
            '--package-directory). With check_clearance: false in the excitation configuration, '
            'the arm moves without collision checks'
        ) from error
    if not any(shape.parentJoint > 0 for shape in geometry.geometryObjects):
        raise ExcitationError(
            'no moving link of the URDF has a <collision> shape, so clearances are unknown: add '
            'shapes, or set check_clearance: false in the excitation configuration to move the '
            'arm without collision checks'
        )
    for shape in geometry.geometryObjects:
        if hasattr(shape.geometry, 'buildConvexHull'):
            shape.geometry.buildConvexHull(True, 'Qt')
            shape.geometry = shape.geometry.convex
    return geometry


def _ground(robot: Robot, height: float) -> pin.GeometryObject:
    gravity = np.asarray(robot.gravity_in_base, dtype=float)
    if not np.linalg.norm(gravity) > 0.0:
        raise ExcitationError(
            'without gravity the ground has no direction: set ground_height to null'
        )
    up = -gravity / np.linalg.norm(gravity)
    plane = pin.hppfcl.Halfspace(up, height)
    return pin.GeometryObject(GROUND, 0, 0, pin.SE3.Identity(), plane)


def link_of(model: pin.Model, geometry: pin.GeometryModel, shape: int) -> str:
    """Return the name of the link to which a shape belongs; 'ground' for the ground."""
    found = geometry.geometryObjects[shape]
    fixed_to_nothing = found.parentJoint == 0 and found.parentFrame == 0
    return str(found.name if fixed_to_nothing else model.frames[found.parentFrame].name)


def motion_bounds(model: pin.Model, geometry: pin.GeometryModel) -> Array:
    """Return upper bounds of distance change per joint angle for all pairs, (pairs, n) [m/rad].

    The distance of two bodies changes by at most the relative motion of their points. A rotation
    of joint j by one radian moves a point of a body by at most the point's distance from the
    joint's axis. A point's distance from the axis is at most the sum of the link lengths between
    joint and body plus the body's radius. For a prismatic joint the bound is 1.

    Raises
    ------
    ExcitationError
        If a prismatic joint has no limits, so that the bounds of preceding joints are infinite.
    """
    bounds = np.zeros((len(geometry.collisionPairs), model.nv))
    for row, pair in enumerate(geometry.collisionPairs):
        for index in (pair.first, pair.second):
            shape = geometry.geometryObjects[index]
            other = geometry.geometryObjects[pair.second if index == pair.first else pair.first]
            bounds[row] += _reach(model, shape, list(model.supports[other.parentJoint]))
    if not np.isfinite(bounds).all():
        raise ExcitationError(
            'the reach of the arm is unknown, because a prismatic joint has no position limits: '
            'add limits of this joint to the URDF'
        )
    return bounds


def _reach(model: pin.Model, shape: pin.GeometryObject, shared: Sequence[int]) -> Array:
    """Return the radius [m] of a shape about each joint that moves it; zero for `shared` joints."""
    reach = np.zeros(model.nv)
    if shape.parentJoint == 0:
        return reach
    shape.geometry.computeLocalAABB()
    radius = float(np.linalg.norm(shape.placement.act(shape.geometry.aabb_center)))
    radius += float(shape.geometry.aabb_radius)
    joint = shape.parentJoint
    while joint > 0:
        # A prismatic joint's travel lengthens the lever of the preceding joints.
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


_SAMPLES = 500
_CONSTANT = 1e-5  # [m]
_BUILT_CLOSE = 1.25
"""Links count as close by design if their distance stays below this multiple of the clearance."""


class CollisionPairs:
    """Pairs of shapes whose distance a motion must keep; the class adds them to the geometry.

    Two kinds of pairs are excluded: moving links connected by one joint, which touch by design,
    and shapes whose distance is constant, for example the ground and a column that turns on the
    base. Links that are too close by design to keep the clearance must keep half of their median
    distance over random postures. The ground, obstacles, and link 1 relative to the base always
    keep the full clearance.

    Parameters
    ----------
    robot : robot model of the arm.
    geometry : shapes of the arm and its surroundings; their pairs are replaced.
    clearance : two required distances [m]: between links or between link and obstacle, and
        between link and ground.
    unchecked : pairs of links excluded by the user, each as 'one to other'.

    Attributes
    ----------
    required : (pairs,) required distance of each pair [m].
    notes : texts on pairs that are not checked, or have less than the requested clearance, as the
        keys of a dictionary: one per pair of links, independent of the number of shapes.

    Raises
    ------
    ExcitationError
        If a pair of `unchecked` does not exist, or a pair cannot keep its clearance in any posture,
        so that no motion is feasible.
    """

    def __init__(
        self,
        robot: Robot,
        geometry: pin.GeometryModel,
        clearance: tuple[float, float],
        unchecked: Sequence[str],
    ) -> None:
        self._robot, self._geometry, self._clearance = robot, geometry, clearance
        self._links = [
            link_of(robot.model, geometry, shape) for shape in range(len(geometry.geometryObjects))
        ]
        self._unchecked = self._read_unchecked(unchecked)
        self._base = robot.joints[0].parent
        self.notes: dict[str, None] = {}
        candidates = self._candidates()
        distances = self._distances(candidates)
        required = {
            pair: keep
            for pair, distance in zip(candidates, distances.T, strict=True)
            if (keep := self._required(pair, distance)) is not None
        }
        self._replace_pairs(list(required))
        self.required = np.array(list(required.values()))

    def _candidates(self) -> list[pin.CollisionPair]:
        """Return all pairs of shapes, except two moving links connected by one joint."""
        shapes, parents = self._geometry.geometryObjects, self._robot.model.parents
        pairs = []
        for b, second in enumerate(shapes):
            for a, first in enumerate(shapes[:b]):
                low, high = sorted((first.parentJoint, second.parentJoint))
                neighbours = low > 0 and parents[high] == low
                if low != high and not neighbours:
                    pairs.append(pin.CollisionPair(a, b))
        return pairs

    def _distances(self, pairs: Sequence[pin.CollisionPair]) -> Array:
        """Return the distances of pairs in random postures, (samples, pairs) [m]."""
        self._replace_pairs(pairs)
        robot, geometry = self._robot, self._geometry
        data, geometry_data = robot.model.createData(), pin.GeometryData(geometry)
        low = np.maximum(robot.position_min, -np.pi)
        high = np.minimum(robot.position_max, np.pi)
        distances = np.empty((_SAMPLES, len(pairs)))
        for row, q in enumerate(np.random.default_rng(0).uniform(low, high, (_SAMPLES, robot.n))):
            pin.computeDistances(robot.model, data, geometry, geometry_data, q)
            distances[row] = [result.min_distance for result in geometry_data.distanceResults]
        return distances

    def _required(self, pair: pin.CollisionPair, distance: Array) -> float | None:
        """Return the required distance of a pair [m]; None if the pair is not checked."""
        wanted = self._clearance[GROUND in self.names(pair)]
        nearest, farthest = float(distance.min()), float(distance.max())
        if frozenset(self.names(pair)) in self._unchecked:
            self._note(pair, 'not checked, because the pair is in unchecked_pairs')
            return None
        if farthest - nearest < _CONSTANT and nearest >= 0.0:
            if nearest < wanted:
                self._note(
                    pair, f'not checked, because the distance is {nearest:.3g} m in every posture'
                )
            return None
        if farthest < 0.0 and set(self.names(pair)) == {self._base, self._robot.link_names[0]}:
            self._note(
                pair,
                'not checked, because joint 1 connects both links, and they overlap in every '
                'posture',
            )
            return None
        if self._both_of_the_arm(pair) and 0.0 <= farthest <= _BUILT_CLOSE * wanted:
            keep = max(min(wanted, 0.5 * float(np.median(distance))), 0.0)
            self._note(
                pair,
                f'close together by design, so the required distance is {keep:.3g} m instead of '
                f'{wanted:g} m',
            )
            return keep
        if farthest < wanted:
            self._raise_too_close(pair, farthest, wanted)
        return wanted

    def _raise_too_close(self, pair: pin.CollisionPair, farthest: float, wanted: float) -> None:
        remedy = (
            'ground_height and ground_clearance'
            if GROUND in self.names(pair)
            else 'sizes and origins of the collision shapes, and self_clearance'
        )
        raise ExcitationError(
            f'{" to ".join(self.names(pair))} has a distance of at most {max(farthest, 0.0):.3g} '
            f'm in every posture, less than the required {wanted:g} m: check {remedy}. If the '
            'links touch by construction, add the pair to unchecked_pairs of the excitation '
            'configuration'
        )

    def _both_of_the_arm(self, pair: pin.CollisionPair) -> bool:
        """Return whether both shapes belong to links of the arm; False for base and link 1."""
        shapes = [self._geometry.geometryObjects[i] for i in (pair.first, pair.second)]
        low, high = sorted(shape.parentJoint for shape in shapes)
        return low > 0 or (self._base in self.names(pair) and high > 1)

    def names(self, pair: pin.CollisionPair) -> tuple[str, str]:
        """Return the names of both links of a pair; 'ground' for the ground."""
        return self._links[pair.first], self._links[pair.second]

    def _note(self, pair: pin.CollisionPair, text: str) -> None:
        self.notes[f'{" to ".join(self.names(pair))}: {text}'] = None

    def _replace_pairs(self, pairs: Sequence[pin.CollisionPair]) -> None:
        self._geometry.removeAllCollisionPairs()
        for pair in pairs:
            self._geometry.addCollisionPair(pair)

    def _read_unchecked(self, unchecked: Sequence[str]) -> set[frozenset[str]]:
        known = {*self._links, GROUND}
        pairs = set()
        for text in unchecked:
            names = frozenset(map(self._robot.full_name, text.split(' to ')))
            if len(names) != 2 or not names <= known:
                raise ExcitationError(
                    f"unchecked_pairs: '{text}' is not a pair of links with collision shapes, "
                    f"such as 'one to other' of {', '.join(sorted(known))}"
                )
            pairs.add(names)
        return pairs


_distance = attrgetter('min_distance')


@dataclass(frozen=True)
class Clearance:
    """Smallest distance along a motion for one kind of pair ('self' or 'ground').

    `distance` [m] is the smallest distance in a sampled posture. `guaranteed` [m] is a lower
    bound of the distance during the whole motion, including times between samples. Both distances
    belong to the pair of bodies with the smallest margin to its `required` distance [m]. `sample`
    is the row number of the posture with the smallest distance.
    """

    subject: str
    distance: float
    guaranteed: float
    required: float
    sample: int


class ClearanceChecker:
    """Check that a motion keeps all required distances, also between its samples.

    Parameters
    ----------
    robot : arm with collision shapes in its URDF.
    self_clearance : required distance between non-adjacent links, and between moving links and
        obstacles fixed to the base [m].
    ground_clearance : required distance between moving links and the ground [m].
    ground_height : see `build_collision_geometry`; None without ground.
    package_directories : see `build_collision_geometry`.
    unchecked_pairs : see `CollisionPairs`.

    Raises
    ------
    ExcitationError
        If a clearance is negative or not finite, the shapes cannot be read, or a pair cannot keep
        its clearance in any posture.
    """

    RESOLUTION = 2e-3
    """Largest difference between the smallest distance found and the guaranteed distance [m]."""

    def __init__(
        self,
        robot: Robot,
        self_clearance: float = 0.02,
        ground_clearance: float = 0.05,
        ground_height: float | None = None,
        package_directories: Sequence[Path] = (),
        unchecked_pairs: Sequence[str] = (),
    ) -> None:
        required = (self_clearance, ground_clearance)
        if not all(np.isfinite(value) and value >= 0.0 for value in required):
            raise ExcitationError(
                f'clearances [m] must be finite and not negative, but are {required}'
            )
        self._model = robot.model
        self._data = robot.model.createData()
        self._geometry = build_collision_geometry(robot, ground_height, package_directories)
        selected = CollisionPairs(robot, self._geometry, required, unchecked_pairs)
        self.required = selected.required
        """Required distance of each pair [m], (pairs,)."""
        self.notes = tuple(selected.notes)
        """Texts about pairs that are not checked or keep less than the requested clearance."""
        self._geometry_data = pin.GeometryData(self._geometry)
        # References into the geometry data are stored once, because indexing takes longer than
        # computing all distances.
        self._results = [self._geometry_data.distanceResults[i] for i in range(len(self.required))]
        self._bounds = motion_bounds(self._model, self._geometry)
        self.steepest: Array = self._bounds.max(axis=0)
        """Upper bounds (n,) [m/rad] of the distance change per joint angle, over all pairs."""
        self.pairs = tuple(map(selected.names, self._geometry.collisionPairs))
        """Names of the two links of each checked pair; 'ground' for the ground."""
        ground = np.array([GROUND in pair for pair in self.pairs], dtype=bool)
        self._kinds = {
            kind: np.flatnonzero(mask)
            for kind, mask in (('self', ~ground), ('ground', ground))
            if mask.any()
        }

    def distances(self, q: Array) -> Array:
        """Return the distance of each pair (pairs,) [m] at q (n,) [rad]; negative for overlap."""
        pin.computeDistances(self._model, self._data, self._geometry, self._geometry_data, q)
        return np.fromiter(map(_distance, self._results), float, len(self._results))

    def margin(self, q: Array) -> float:
        """Return the smallest margin, distance minus required distance, at q (n,) [m]."""
        return float((self.distances(q) - self.required).min())

    def margin_gradient(self, q: Array) -> Array:
        """Return the derivative of `margin` with respect to the joint positions, (n,) [m/rad].

        The derivative equals the relative velocity of the two nearest points along their connecting
        line.
        """
        pair = int((self.distances(q) - self.required).argmin())
        result, shapes = self._results[pair], self._geometry.collisionPairs[pair]
        pin.computeJointJacobians(self._model, self._data, q)
        first = self._point_jacobian(shapes.first, result.getNearestPoint1())
        second = self._point_jacobian(shapes.second, result.getNearestPoint2())
        return np.asarray(result.normal @ (second - first))

    def _point_jacobian(self, shape: int, point: Array) -> Array:
        """Return the Jacobian (3, n) of a point that is fixed to a shape, in the base frame."""
        joint = self._geometry.geometryObjects[shape].parentJoint
        if joint == 0:
            return np.zeros((3, self._model.nv))
        jacobian = pin.getJointJacobian(
            self._model, self._data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        lever = point - self._data.oMi[joint].translation
        return np.asarray(jacobian[:3] - pin.skew(lever) @ jacobian[3:])

    def sweep(self, positions: Array, stop_below: bool = False) -> dict[str, Clearance]:
        """Return the smallest distances of a motion, for each kind of pair ('self', 'ground').

        The motion is divided into intervals (branch and bound). Distances are computed in the
        middle of an interval; elsewhere in the interval distances are smaller by at most sum_j
        L_j |q_j - q_j,mid|, with the bounds L of `motion_bounds`. An interval that may contain a
        smaller margin than the smallest one found is halved, down to neighbouring samples.

        Parameters
        ----------
        positions : (M, n) postures [rad], dense enough that between neighbours each joint moves
            monotonically or negligibly (the control cycle).
        stop_below : whether to stop at the first posture that is too close; the guaranteed
            distances are then invalid.
        """
        worst = {kind: _Worst() for kind in self._kinds}
        intervals = deque(self._initial_intervals(len(positions)))
        while intervals:
            low, high = intervals.popleft()
            middle = (low + high) // 2
            travel = np.abs(positions[low : high + 1] - positions[middle]).max(axis=0)
            margin = self.distances(positions[middle]) - self.required
            bound = margin - self._bounds @ travel
            for kind, rows in self._kinds.items():
                worst[kind].see(margin, rows, middle)
            if stop_below and (margin < 0.0).any():
                break
            is_open = any(
                bound[rows].min() < worst[kind].margin - self.RESOLUTION
                for kind, rows in self._kinds.items()
            )
            if is_open and high - low > 1:
                intervals += [(low, middle), (middle, high)]
            else:
                for kind, rows in self._kinds.items():
                    worst[kind].guaranteed = min(worst[kind].guaranteed, bound[rows].min())
        return {kind: self._clearance(found) for kind, found in worst.items()}

    @staticmethod
    def _initial_intervals(samples: int) -> list[tuple[int, int]]:
        edges = [*range(0, max(samples - 1, 1), 64), samples - 1]
        return list(zip(edges, edges[1:], strict=False)) or [(0, 0)]

    def _clearance(self, worst: _Worst) -> Clearance:
        first, second = self.pairs[worst.pair]
        required = float(self.required[worst.pair])
        return Clearance(
            f'{first} to {second}',
            required + worst.margin,
            required + float(min(worst.guaranteed, worst.margin)),
            required,
            worst.sample,
        )


@dataclass
class _Worst:
    """Smallest margin, distance minus required distance, found so far for one kind of pair [m]."""

    margin: float = np.inf
    guaranteed: float = np.inf
    pair: int = 0
    sample: int = 0

    def see(self, margin: Array, rows: NDArray[np.intp], sample: int) -> None:
        row = rows[margin[rows].argmin()]
        if margin[row] < self.margin:
            self.margin, self.pair, self.sample = float(margin[row]), int(row), sample
