"""Remaining reach of the arm under a moving drone, and the preferred position of the drone."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks import JointLimits, finite, positive
from aerarm_ros.control.laws.kinematic_control import DampedInverse
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.flight.flight_state import yaw_of
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import Array
from aerarm_ros.world.base_pose import BasePose

_REACHED = 3e-3  # [m] largest error of a reached place
_STEP = 0.02  # [m] step along a direction
_FARTHEST = 0.3  # [m] largest searched distance
_STEP_ITERATIONS, _ITERATIONS, _MORE_ITERATIONS = 3, 40, 12
_LOOKS = 12  # places of a path, limited because a controller checks between two states
_LARGEST_TURN = 0.3  # [rad] of a joint in an iteration
_MARGIN = 0.03  # [rad] margin to position limits
_LONGEST = 60.0  # [s] longest reported time
_SLOW = 0.01  # [m/s]

DIRECTIONS = np.vstack([np.eye(3), -np.eye(3)])
"""Directions (6, 3) in the world: along the positive, then along the negative axes."""


class ReachMargin(NamedTuple):
    """Distances [m] that the drone can move while the arm keeps the tool in place.

    Attributes
    ----------
    along : (6,) ndarray
        Possible motion of the base along each of `DIRECTIONS` [m], at most 0.3 m.
    least : float
        Smallest of the distances in `along` [m].
    time : float
        Time until the end of the reach at the present velocity of the base, up to 60 [s].
    """

    along: Array
    least: float
    time: float


class ArmReach:
    """Finds by inverse kinematics whether the tool can reach points.

    The search starts at the present posture. A point beyond a singularity, which the arm could only
    reach by another path, counts as out of reach.

    Parameters
    ----------
    kinematics : Kinematics
        An instance for this object alone, if used in another thread.
    """

    def __init__(
        self, kinematics: Kinematics, limits: JointLimits, inverse: DampedInverse | None = None
    ) -> None:
        self._kinematics = kinematics
        self._low = limits.position_min + _MARGIN
        self._high = limits.position_max - _MARGIN
        self._inverse = DampedInverse(0.03, 0.02) if inverse is None else inverse

    def beyond_any(self, places: Array, q: Array) -> float:
        """Return how far [m] the points (M, 3) of a path are out of reach at most; 0 within reach.

        At most 12 points are checked, each from the posture of the previous one.
        """
        looked = np.unique(np.linspace(0, len(places) - 1, _LOOKS).round().astype(int))
        farthest, iterations = 0.0, _ITERATIONS
        for place in places[looked]:
            q, off = self._approach(place, q, iterations)
            farthest, iterations = max(farthest, off), _MORE_ITERATIONS
        return 0.0 if farthest <= _REACHED else farthest

    def margin(self, q: Array, pose: BasePose, place: Array) -> ReachMargin:
        """Return how far the base can move while the tool stays at a point (3,) of the world."""
        along = np.array([self._way(q, pose, place, direction) for direction in DIRECTIONS])
        speed, time = float(np.linalg.norm(pose.velocity)), _LONGEST
        if speed > _SLOW:
            time = min(self._way(q, pose, place, pose.velocity / speed) / speed, _LONGEST)
        return ReachMargin(along, float(along.min()), time)

    def _way(self, q: Array, pose: BasePose, place: Array, direction: Array) -> float:
        way = 0.0
        while way < _FARTHEST:
            moved = pose._replace(position=pose.position + (way + _STEP) * direction)
            q, off = self._approach(moved.to_base(place), q, _STEP_ITERATIONS)
            if off > _REACHED:
                return way + max(0.0, _STEP - off)
            way += _STEP
        return _FARTHEST

    def _approach(self, place: Array, q: Array, iterations: int) -> tuple[Array, float]:
        """Return the posture that brings the tool nearest to a point, and the distance left [m]."""
        for _ in range(iterations):
            error = place - self._kinematics.position(q)
            if error @ error < (0.1 * _REACHED) ** 2:
                break
            turn = self._inverse.of(self._kinematics.position_jacobian(q)).inverse @ error
            largest = float(np.abs(turn).max())
            turn = turn * min(1.0, _LARGEST_TURN / largest) if largest > 0.0 else turn
            q = np.minimum(np.maximum(q + turn, self._low), self._high)
        return q, float(np.linalg.norm(place - self._kinematics.position(q)))


class DroneRequest:
    """Slow set point for the drone, which returns the arm to the middle of its reach.

    The set point depends on the tool's target and on the heading at the first update, but neither
    on the drone's position nor on the arm's posture. It therefore closes no feedback loop. If the
    goal is further away than `deadband`, the set point moves to the goal at `speed`.

    Parameters
    ----------
    middle : (n,) array_like
        Posture in which the arm is in the middle of its reach [rad].
    speed : float
        Speed of the set point [m/s].
    deadband : float
        Distance of the set point from its goal above which the set point begins to move [m].
    """

    def __init__(
        self,
        kinematics: Kinematics,
        drone: DroneConfig,
        middle: npt.ArrayLike,
        speed: float = 0.05,
        deadband: float = 0.03,
    ) -> None:
        posture = finite('middle', middle, kinematics.robot.n)
        self._to_mount, self._mount = drone.mount.rotation, np.array(drone.mount.position)
        self._tool = self._mount + self._to_mount @ kinematics.position(posture)  # in body axes
        self._speed, self._deadband = positive('speed', speed), positive('deadband', deadband)
        self.reset()

    def reset(self) -> None:
        """Start at the drone's position and heading at the next update."""
        self._state: tuple[Array, Array, float] | None = None
        self._moves = False

    def update(self, now: float, target: Array, pose: BasePose) -> tuple[Array, Array]:
        """Return the position (3,) and heading (3, 3) of the set point, for a tool target (3,)."""
        if self._state is None:
            body = pose.rotation @ self._to_mount.T
            yaw = yaw_of(body)
            c, s = np.cos(yaw), np.sin(yaw)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            self._state = pose.position - body @ self._mount, turn, now
        place, turn, before = self._state
        way = target - turn @ self._tool - place
        left = float(np.linalg.norm(way))
        self._moves = left > (1e-6 if self._moves else self._deadband)
        if self._moves:
            step = self._speed * min(max(now - before, 0.0), 1.0)
            place = place + min(1.0, step / left) * way
        self._state = place, turn, now
        return place, turn
