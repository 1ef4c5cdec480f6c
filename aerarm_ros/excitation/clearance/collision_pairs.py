"""Which shapes of an arm have to keep apart, and how far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.clearance.collision_geometry import GROUND, link_of, touches_ground
from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray

_SAMPLES = 500
_CONSTANT = 1e-5  # [m]
_BUILT_CLOSE = 1.25
"""Links that never get further apart than this times the clearance are built close together."""


@dataclass(frozen=True)
class CollisionPairs:
    """What was decided about the pairs that are left in the geometry model.

    Parameters
    ----------
    required : (pairs,) distance each pair keeps [m].
    notes : pairs that are not checked, or that keep less than the clearance asked for, in words.
    """

    required: FloatArray
    notes: tuple[str, ...]


def select_pairs(
    robot: Robot,
    geometry: pin.GeometryModel,
    clearance: tuple[float, float],
    unchecked: Sequence[str] = (),
) -> CollisionPairs:
    """Put the pairs that a motion has to keep apart into `geometry`.

    Not a pair: two moving links joined by one joint, which touch by construction, and what
    never changes its distance, such as the column that turns on the base and the ground below
    it: no motion brings these nearer. Links of the arm built so close together that they can
    hardly keep the clearance have to keep half of their median distance over random postures.
    The ground, obstacles and link 1 beside the base always keep the whole clearance.

    Parameters
    ----------
    robot : the arm.
    geometry : its shapes and surroundings; its pairs are replaced.
    clearance : distances asked for [m], (arm to itself and to obstacles, arm to ground).
    unchecked : pairs of links the user answers for, each as 'one to other'.

    Raises
    ------
    ExcitationError
        If a pair of `unchecked` does not exist, or a pair cannot keep its clearance in any
        posture, so that no motion would be feasible.
    """
    selection = _Selection(robot, geometry, clearance, unchecked)
    return selection.apply()


class _Selection:
    """See `select_pairs`."""

    def __init__(
        self,
        robot: Robot,
        geometry: pin.GeometryModel,
        clearance: tuple[float, float],
        unchecked: Sequence[str],
    ) -> None:
        self._robot, self._geometry = robot, geometry
        self._own_clearance, self._ground_clearance = clearance
        self._links = [
            link_of(robot.model, geometry, shape) for shape in range(len(geometry.geometryObjects))
        ]
        self._unchecked = self._read_unchecked(unchecked)
        self._base = robot.joints[0].parent
        # A dictionary keeps one note a pair of links, however many shapes they have.
        self._notes: dict[str, None] = {}

    def apply(self) -> CollisionPairs:
        candidates = self._candidates()
        distances = self._distances(candidates)
        kept, required = [], []
        for pair, distance in zip(candidates, distances.T, strict=True):
            keep = self._required(pair, distance)
            if keep is not None:
                kept.append(pair)
                required.append(keep)
        self._replace_pairs(kept)
        return CollisionPairs(np.array(required), tuple(self._notes))

    def _candidates(self) -> list[pin.CollisionPair]:
        """Return all pairs but those of two moving links joined by one joint."""
        shapes, parents = self._geometry.geometryObjects, self._robot.model.parents
        pairs = []
        for b, second in enumerate(shapes):
            for a, first in enumerate(shapes[:b]):
                low, high = sorted((first.parentJoint, second.parentJoint))
                neighbours = low > 0 and parents[high] == low
                if low != high and not neighbours:
                    pairs.append(pin.CollisionPair(a, b))
        return pairs

    def _distances(self, pairs: Sequence[pin.CollisionPair]) -> FloatArray:
        """Return the distances in random postures (samples, pairs) [m]."""
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

    def _required(self, pair: pin.CollisionPair, distance: FloatArray) -> float | None:
        """Return what a pair has to keep [m], None if it is not to be checked."""
        wanted = self._wanted(pair)
        nearest, farthest = float(distance.min()), float(distance.max())
        if frozenset(self._names(pair)) in self._unchecked:
            self._note(pair, 'not checked, as configured')
            return None
        if farthest - nearest < _CONSTANT and nearest >= 0.0:
            if nearest < wanted:
                self._note(pair, f'{nearest:.3g} m in every posture, not checked')
            return None
        if farthest < 0.0 and self._is_base_and_link_1(pair):
            self._note(pair, 'joined by joint 1 and overlapping in every posture, not checked')
            return None
        if self._both_of_the_arm(pair) and 0.0 <= farthest <= _BUILT_CLOSE * wanted:
            keep = max(min(wanted, 0.5 * float(np.median(distance))), 0.0)
            self._note(pair, f'built close together, keeps {keep:.3g} m instead of {wanted:g} m')
            return keep
        if farthest < wanted:
            self._refuse(pair, farthest, wanted)
        return wanted

    def _refuse(self, pair: pin.CollisionPair, farthest: float, wanted: float) -> None:
        subject = ' to '.join(self._names(pair))
        found = (
            'overlaps in every posture'
            if farthest < 0.0
            else f'is never more than {farthest:.3g} m apart, {wanted - farthest:.2g} m less than '
            f'the {wanted:g} m to be kept'
        )
        remedy = (
            'ground_height and ground_clearance'
            if touches_ground(self._geometry, pair)
            else "the collision shapes' sizes and origins and self_clearance"
        )
        raise ExcitationError(
            f'{subject} {found}: check {remedy}, or name the pair in unchecked_pairs of the '
            'excitation configuration if it touches by construction'
        )

    def _wanted(self, pair: pin.CollisionPair) -> float:
        ground = touches_ground(self._geometry, pair)
        return self._ground_clearance if ground else self._own_clearance

    def _is_base_and_link_1(self, pair: pin.CollisionPair) -> bool:
        return set(self._names(pair)) == {self._base, self._robot.link_names[0]}

    def _both_of_the_arm(self, pair: pin.CollisionPair) -> bool:
        """Whether neither is an obstacle: moving links, or the base's own link and link 2 on."""
        shapes = [self._geometry.geometryObjects[i] for i in (pair.first, pair.second)]
        low, high = sorted(shape.parentJoint for shape in shapes)
        return low > 0 or (self._base in self._names(pair) and high > 1)

    def _names(self, pair: pin.CollisionPair) -> tuple[str, str]:
        return self._links[pair.first], self._links[pair.second]

    def _note(self, pair: pin.CollisionPair, text: str) -> None:
        self._notes[f'{" to ".join(self._names(pair))}: {text}'] = None

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
                    f"unchecked_pairs: '{text}' is no pair of links with collision shapes, such "
                    f"as 'one to other' of {', '.join(sorted(known))}"
                )
            pairs.add(names)
        return pairs
