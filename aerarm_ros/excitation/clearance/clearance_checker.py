"""Distances of the arm to itself, to what is fixed to its base, and to the ground."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance.collision_geometry import (
    build_collision_geometry,
    link_of,
    motion_bounds,
    touches_ground,
)
from aerarm_ros.excitation.clearance.collision_pairs import select_pairs
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray

_distance = attrgetter('min_distance')


@dataclass(frozen=True)
class Clearance:
    """Smallest distance found for one kind of pair.

    `distance` [m] is what a posture of the motion reaches, `guaranteed` [m] what the whole motion
    keeps, between the samples too. Both are of the pair that comes closest to its `required`
    distance [m], or falls shortest of it. `sample` is the row of the posture.
    """

    subject: str
    distance: float
    guaranteed: float
    required: float
    sample: int


class ClearanceChecker:
    """Certifies that a motion keeps its distance, between the samples as well.

    Parameters
    ----------
    robot : arm with collision shapes in its URDF.
    self_clearance : required between links that are not neighbours, and between moving links and
        what is fixed to the base [m].
    ground_clearance : required between moving links and the ground [m].
    ground_height : see `build_collision_geometry`; None without ground.
    package_directories : see `build_collision_geometry`.
    unchecked_pairs : see `select_pairs`.

    Raises
    ------
    ExcitationError
        If a clearance is negative or not finite, the shapes cannot be read, or a pair cannot
        keep its clearance in any posture.
    """

    RESOLUTION = 2e-3
    """How far below the smallest distance found the guaranteed one may lie [m]."""

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
            raise ExcitationError(f'clearances must not be negative, got {required} m')
        self._model = robot.model
        self._data = robot.model.createData()
        self._geometry = build_collision_geometry(robot, ground_height, package_directories)
        selected = select_pairs(robot, self._geometry, required, unchecked_pairs)
        self._required = selected.required
        self.notes = selected.notes
        """Pairs that are not checked or keep less than asked for, in words."""
        self._geometry_data = pin.GeometryData(self._geometry)
        # References into the data, taken once: indexing it anew costs more than all distances.
        self._results = [self._geometry_data.distanceResults[i] for i in range(len(self._required))]
        self._bounds = motion_bounds(self._model, self._geometry)
        ground = np.array(
            [touches_ground(self._geometry, pair) for pair in self._geometry.collisionPairs],
            dtype=bool,
        )
        self._kinds = {
            kind: np.flatnonzero(mask)
            for kind, mask in (('self', ~ground), ('ground', ground))
            if mask.any()
        }

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The links of each checked pair of shapes; 'ground' stands for the ground."""
        model, geometry = self._model, self._geometry
        return tuple(
            (link_of(model, geometry, pair.first), link_of(model, geometry, pair.second))
            for pair in geometry.collisionPairs
        )

    @property
    def shapes(self) -> list[pin.GeometryObject]:
        """The collision shapes, meshes as convex hulls, and the ground if there is one."""
        return list(self._geometry.geometryObjects)

    @property
    def required(self) -> FloatArray:
        """Required distance of each pair [m], (pairs,)."""
        return self._required

    @property
    def steepest(self) -> FloatArray:
        """(n,) how much a joint can change the distance of any pair at most [m/rad]."""
        return np.asarray(self._bounds.max(axis=0))

    def distances(self, q: FloatArray) -> FloatArray:
        """Return the distance of each pair at q (n,) [rad]: (pairs,) [m], negative if inside."""
        pin.computeDistances(self._model, self._data, self._geometry, self._geometry_data, q)
        return np.fromiter(map(_distance, self._results), float, len(self._results))

    def margin(self, q: FloatArray) -> float:
        """Return by how much the worst pair exceeds its required distance at q (n,) [m]."""
        return float((self.distances(q) - self._required).min())

    def margin_gradient(self, q: FloatArray) -> FloatArray:
        """Return the derivative (n,) of `margin` [m/rad].

        The distance grows with the relative velocity of the two nearest points along the line
        through them.
        """
        pair = int((self.distances(q) - self._required).argmin())
        result, shapes = self._results[pair], self._geometry.collisionPairs[pair]
        pin.computeJointJacobians(self._model, self._data, q)
        first = self._point_jacobian(shapes.first, result.getNearestPoint1())
        second = self._point_jacobian(shapes.second, result.getNearestPoint2())
        return np.asarray(result.normal @ (second - first))

    def _point_jacobian(self, shape: int, point: FloatArray) -> FloatArray:
        """Return the Jacobian (3, n) of a point [m] fixed to a shape, in the base frame."""
        joint = self._geometry.geometryObjects[shape].parentJoint
        if joint == 0:
            return np.zeros((3, self._model.nv))
        jacobian = pin.getJointJacobian(
            self._model, self._data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        lever = point - self._data.oMi[joint].translation
        return np.asarray(jacobian[:3] - pin.skew(lever) @ jacobian[3:])

    def sweep(self, positions: FloatArray, stop_below: bool = False) -> dict[str, Clearance]:
        """Return the clearance of a motion, per kind of pair ('self', 'ground').

        Branch and bound on intervals of the motion: in the middle of an interval the distances
        are computed, and elsewhere in it they are lower by at most sum_j L_j |q_j - q_j,mid|
        (see `motion_bounds`). An interval whose bound might undercut the smallest margin found
        is halved, down to neighbouring samples.

        Parameters
        ----------
        positions : (M, n) postures [rad], dense enough that between neighbours each joint moves
            monotonically or negligibly (the control cycle).
        stop_below : stop at the first posture that is too close; what is guaranteed is then not
            meant to be used.
        """
        worst = {kind: _Worst() for kind in self._kinds}
        intervals = deque(self._initial_intervals(len(positions)))
        while intervals:
            low, high = intervals.popleft()
            middle = (low + high) // 2
            travel = np.abs(positions[low : high + 1] - positions[middle]).max(axis=0)
            margin = self.distances(positions[middle]) - self._required
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
    def _initial_intervals(samples: int, length: int = 64) -> list[tuple[int, int]]:
        edges = [*range(0, max(samples - 1, 1), length), samples - 1]
        return list(zip(edges, edges[1:], strict=False)) or [(0, 0)]

    def _clearance(self, worst: _Worst) -> Clearance:
        first, second = self.pairs[worst.pair]
        required = float(self._required[worst.pair])
        return Clearance(
            f'{first} to {second}',
            required + worst.margin,
            required + float(min(worst.guaranteed, worst.margin)),
            required,
            worst.sample,
        )


@dataclass
class _Worst:
    """Smallest margin beyond the required distance so far [m], of one kind of pair."""

    margin: float = np.inf
    guaranteed: float = np.inf
    pair: int = 0
    sample: int = 0

    def see(self, margin: FloatArray, rows: NDArray[np.intp], sample: int) -> None:
        row = rows[margin[rows].argmin()]
        if margin[row] < self.margin:
            self.margin, self.pair, self.sample = float(margin[row]), int(row), sample
