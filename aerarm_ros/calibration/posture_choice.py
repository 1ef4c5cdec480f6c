"""Choice of calibration postures by D-optimality (largest determinant of the information)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerarm_ros.calibration.choice import LEVELS, identifiable
from aerarm_ros.calibration.fit import Fit, free_columns
from aerarm_ros.calibration.geometry import ArmGeometry
from aerarm_ros.calibration.observations import CalibrationError, MarkerSource, Observations
from aerarm_ros.motion.signals import Array

_CANDIDATES = 400
_MARGIN = 0.05  # [rad], [m] distance from the joint limits
# regularization of the information matrix before the first posture, relative to its trace
_REGULAR = 1e-6
_FACING = 0.5  # cosine of the largest angle between a visible marker's normal and line of sight
_EXCHANGES = 3  # passes over the chosen postures
# Positions of the assumed markers, not collinear [m].
_PLACES = ((0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (0.0, 0.0, 0.08))


@dataclass(frozen=True, eq=False)
class PostureChoice:
    """Postures chosen for a calibration.

    Attributes
    ----------
    q : (M, n) ndarray
        Joint positions of the M postures [rad], in the order in which the arm visits them.
    information : float
        Logarithm of the information matrix's determinant divided by the number of errors, minus
        the same value for as many random postures; positive means better than random.
    parameters : int
        Number of geometric errors that the postures identify.
    """

    q: Array
    information: float
    parameters: int


def choose_postures(
    geometry: ArmGeometry,
    count: int,
    is_allowed: Callable[[Array], bool],
    start: Array | None = None,
    seed: int = 0,
) -> PostureChoice:
    """Return the postures that identify the geometric errors best.

    Candidates are random postures within the joint limits that are allowed. A greedy
    choice among these candidates maximizes the determinant of the information matrix of all
    identifiable errors, base frame and markers. In the end each chosen posture is exchanged for a
    better candidate, if one exists (Fedorov 1972).

    Parameters
    ----------
    count : int
        Number of postures to choose.
    is_allowed : callable
        Returns whether a posture (n,) is allowed, given self-collisions, the ground and visibility.
    start : (n,) ndarray, optional
        Present posture [rad], from which the order of visits begins.
    seed : int
        Seed of the random postures.

    Raises
    ------
    CalibrationError
        If too few postures are allowed.
    """
    q = _candidates(geometry, count, is_allowed, seed)
    fit = _assumed(geometry, q)
    columns = identifiable(fit, LEVELS['geometry']).columns
    rows = free_columns(fit, columns).reshape(len(q), -1, len(columns) + len(fit.names))
    information = np.einsum('mki,mkj->mij', rows, rows)
    chosen = _greedy(information, count)
    chosen = _exchanged(information, chosen)
    sums = [information[rows].sum(axis=0) for rows in (chosen, range(count))]
    found, random = np.linalg.slogdet(np.array(sums))[1]
    gain = float(found - random)
    order = _shortest_way(q[chosen], start)
    return PostureChoice(q[chosen][order], gain / information.shape[1], len(columns))


def faces_camera(geometry: ArmGeometry, camera: Array, normal: Array) -> Callable[[Array], bool]:
    """Return a function that returns whether a marker faces the camera in a posture (n,).

    A marker is visible up to 60 degrees between its normal and the line of sight.

    Parameters
    ----------
    camera : (3,) ndarray
        Position of the camera in the base frame [m].
    normal : (3,) ndarray
        Normal of the marker, in the frame of the link.

    Raises
    ------
    CalibrationError
        If the normal is zero.
    """
    length = np.linalg.norm(normal)
    if length == 0.0:
        raise CalibrationError('the marker normal is 0 0 0: pass a vector of non-zero length')

    def is_visible(q: Array) -> bool:
        poses = geometry.poses(q[None], np.zeros(len(geometry.names)))
        sight = camera - poses.position[0]
        projection = (poses.rotation[0] @ normal) @ sight
        return bool(projection > _FACING * length * np.linalg.norm(sight))

    return is_visible


def _candidates(
    geometry: ArmGeometry, count: int, is_allowed: Callable[[Array], bool], seed: int
) -> Array:
    low, high = geometry.robot.posture_range
    generator = np.random.default_rng(seed)
    wanted, tried = max(_CANDIDATES, 4 * count), 0
    found: list[Array] = []
    while len(found) < wanted and tried < 20 * wanted:
        tried += 1
        posture = generator.uniform(low + _MARGIN, high - _MARGIN)
        if is_allowed(posture):
            found.append(posture)
    if len(found) < 2 * count:
        raise CalibrationError(
            f'only {len(found)} of {tried} random postures are allowed: check the clearances and '
            'the ground, with --camera also the camera position and the marker normal, or request '
            f'fewer than {count} postures'
        )
    return np.array(found)


def _assumed(geometry: ArmGeometry, q: Array) -> Fit:
    """Return a fit without errors, for the nominal arm with three assumed markers on the link."""
    names = ('a', 'b', 'c')
    source = MarkerSource('mocap', names, np.zeros((len(q), len(names), 3)))
    state = np.concatenate([np.eye(3).ravel(), np.zeros(3), np.ravel(_PLACES)])
    poses = geometry.poses(q, np.zeros(len(geometry.names)))
    # Assume error-free measurements, because a robust loss weights residuals.
    exact = source.residuals(poses, state).reshape(len(q), len(names), 3)
    source = MarkerSource('mocap', names, exact)
    return Fit(geometry, Observations(q, (source,)), (), np.zeros(len(geometry.names)), (state,))


def _greedy(information: Array, count: int) -> list[int]:
    width = information.shape[1]
    total = _REGULAR * np.trace(information.mean(axis=0)) / width * np.eye(width)
    chosen: list[int] = []
    for _ in range(count):
        values = np.linalg.slogdet(total + information)[1]
        values[chosen] = -np.inf
        best = int(np.argmax(values))
        chosen.append(best)
        total = total + information[best]
    return chosen


def _exchanged(information: Array, chosen: list[int]) -> list[int]:
    chosen = list(chosen)
    for _ in range(_EXCHANGES):
        changed = False
        for place in range(len(chosen)):
            others = [k for i, k in enumerate(chosen) if i != place]
            values = np.linalg.slogdet(information[others].sum(axis=0) + information)[1]
            values[others] = -np.inf
            best = int(np.argmax(values))
            if values[best] > values[chosen[place]] + 1e-9:
                chosen[place] = best
                changed = True
        if not changed:
            break
    return chosen


def _shortest_way(q: Array, start: Array | None) -> list[int]:
    """Return an order of the postures: each posture is followed by the nearest remaining one."""
    left = list(range(len(q)))
    at = q[0] if start is None else start
    order = []
    while left:
        nearest = min(left, key=lambda k: float(np.abs(q[k] - at).max()))
        order.append(nearest)
        left.remove(nearest)
        at = q[nearest]
    return order
