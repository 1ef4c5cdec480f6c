"""Sensor measurements of an arm at rest, and their prediction by the arm's geometry.

Each source of observations has its own unknowns: the base frame in the sensor's frame, and the
points or frames attached to the arm. A source predicts its measurements from the poses of the link
to which it is attached, with derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from aerarm_ros.calibration.geometry import LinkPoses
from aerarm_ros.motion.signals import Array

Mask = npt.NDArray[np.bool_]
"""Boolean mask of rows."""


class CalibrationError(ValueError):
    """Error for unusable data or options; the message states the faulty entry and what to check."""


_AXES = ('x', 'y', 'z', 'rx', 'ry', 'rz')
_REGISTERED = 150  # largest number of postures from which a registration starts
_STARTS = 400  # number of initial base rotations that a registration tries
_SPREAD = 0.35  # [rad] typical angle between the true base rotation and the nearest initial one
_REFINED = 6


@dataclass(frozen=True, eq=False)
class MarkerSource:
    """Measured positions of markers, which are fixed to the link at unknown positions.

    A missing measurement of a source is NaN. The state of a source begins with rotation (9) and
    translation (3) of the base frame.

    Attributes
    ----------
    name : str
        Name in reports.
    names : tuple of str
        Names of the markers.
    position : (M, markers, 3) ndarray
        Positions in the sensor's frame [m].
    """

    name: str
    names: tuple[str, ...]
    position: Array

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns: base frame (6), and position of each marker on the link (3)."""
        places = tuple(f'{marker}.{axis}' for marker in self.names for axis in 'xyz')
        return (*_base_names(self), *places)

    @property
    def channels(self) -> tuple[tuple[str, str], ...]:
        """Names and units of the residuals: three position coordinates per marker."""
        return tuple((f'{marker} {axis}', 'm') for marker in self.names for axis in 'xyz')

    def residuals(self, poses: LinkPoses, state: Array) -> Array:
        """Return predicted minus measured positions (M, 3 markers) [m]; NaN if not measured."""
        (rotation, translation), places = base_pose(state), state[12:].reshape(-1, 3)
        in_base = poses.position[:, None] + np.einsum('mij,kj->mki', poses.rotation, places)
        predicted = in_base @ rotation.T + translation
        return np.asarray((predicted - self.position).reshape(len(self.position), -1))

    def jacobians(self, poses: LinkPoses, state: Array) -> tuple[Array, Array]:
        """Return the derivatives of the residuals by geometric errors and by the unknowns.

        The arrays are (M, K, P) for the P columns of `poses.jacobian`, and (M, K, U) for the U
        unknowns of the source.
        """
        (rotation, _), places = base_pose(state), state[12:].reshape(-1, 3)
        count, markers = len(self.position), len(self.names)
        lever = np.einsum('mij,kj->mki', poses.rotation, places)
        linear, angular = poses.jacobian[:, :3], poses.jacobian[:, 3:]
        by_errors = np.empty((count, markers, 3, linear.shape[-1]))
        by_unknowns = np.zeros((count, markers, 3, 6 + 3 * markers))
        for k in range(markers):
            by_errors[:, k] = rotation @ (linear + _turned(angular, lever[:, k]))
            at = (poses.position + lever[:, k]) @ rotation.T
            by_unknowns[:, k, :, :3] = np.eye(3)
            by_unknowns[:, k, :, 3:6] = -cross_matrix(at)
            by_unknowns[:, k, :, 6 + 3 * k : 9 + 3 * k] = rotation @ poses.rotation
        shape = (count, 3 * markers, -1)
        return by_errors.reshape(shape), by_unknowns.reshape(shape)

    def linear(self, poses: LinkPoses, rotation: Array) -> tuple[float, Array]:
        """Return the least squared residual and the best state for a base rotation (3, 3)."""
        seen: Mask = np.asarray(np.isfinite(self.position).all(axis=2))
        rows, values = [], []
        markers = len(self.names)
        turned = rotation @ poses.rotation
        target = self.position - (poses.position @ rotation.T)[:, None]
        for k in range(markers):
            block = np.zeros((int(seen[:, k].sum()), 3, 3 + 3 * markers))
            block[:, :, :3] = np.eye(3)
            block[:, :, 3 + 3 * k : 6 + 3 * k] = turned[seen[:, k]]
            rows.append(block.reshape(-1, 3 + 3 * markers))
            values.append(target[seen[:, k], k].ravel())
        matrix, value = np.vstack(rows), np.concatenate(values)
        solution = np.linalg.lstsq(matrix, value, rcond=1e-9)[0]
        cost = float(np.sum((matrix @ solution - value) ** 2))
        return cost, np.concatenate([rotation.ravel(), solution])

    def moved(self, state: Array, step: Array) -> Array:
        """Return the state changed by a step (U,) of base frame and marker positions."""
        moved = _moved_base(state, step[:6])
        moved[12:] += step[6:]
        return moved

    def rows(self, index: npt.NDArray[Any]) -> Self:
        """Return a source that contains only the postures `index`."""
        return replace(self, position=self.position[index])

    @property
    def seen(self) -> Mask:
        """Mask (M,) of postures with a visible marker."""
        seen: Mask = np.asarray(np.isfinite(self.position).all(axis=2))
        return np.asarray(seen.any(axis=1))


@dataclass(frozen=True, eq=False)
class PoseSource:
    """Poses of a body on the link, or of a fixed body measured by a camera on the link.

    Attributes
    ----------
    position : (M, 3) ndarray
        Position of the body in the sensor's frame [m].
    eye_in_hand : bool
        Whether the camera is on the link and observes a fixed body. The unknown base frame is
        then expressed in the fixed body's frame, and the unknown attached frame is the camera's
        frame.
    """

    name: str
    rotation: Array
    position: Array
    eye_in_hand: bool = False

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns: base frame (6), and attached frame relative to the link (6)."""
        what = 'camera' if self.eye_in_hand else 'body'
        return (*_base_names(self), *(f'{self.name}.{what}.{axis}' for axis in _AXES))

    @property
    def channels(self) -> tuple[tuple[str, str], ...]:
        """Names and units of the six residuals: three of position, three of rotation."""
        return tuple(
            (f'{self.name} {axis}', 'rad' if axis.startswith('r') else 'm') for axis in _AXES
        )

    def residuals(self, poses: LinkPoses, state: Array) -> Array:
        """Return predicted minus measured poses (M, 6): position [m] and rotation vector [rad]."""
        rotation, position = self._predicted(poses, state)
        turn = Rotation.from_matrix(np.swapaxes(self._filled(), 1, 2) @ rotation).as_rotvec()
        # In the sensor's axes, like the positions.
        turn = np.einsum('mij,mj->mi', self._filled(), turn)
        residuals = np.hstack([position - self.position, turn])
        residuals[~self.seen] = np.nan
        return residuals

    def jacobians(self, poses: LinkPoses, state: Array) -> tuple[Array, Array]:
        """Return derivatives of the residuals by errors and unknowns, for small rotations."""
        base, _, attached = _split_poses(state)
        lever = poses.rotation @ attached[1]
        linear, angular = poses.jacobian[:, :3], poses.jacobian[:, 3:]
        by_errors = np.concatenate(
            [base @ (linear + _turned(angular, lever)), base @ angular], axis=1
        )
        count = len(self.position)
        by_unknowns = np.zeros((count, 6, 12))
        at = (poses.position + lever) @ base.T
        by_unknowns[:, :3, :3] = np.eye(3)
        by_unknowns[:, :3, 3:6] = -cross_matrix(at)
        by_unknowns[:, 3:, 3:6] = np.eye(3)
        turned = base @ poses.rotation
        by_unknowns[:, :3, 6:9] = turned
        by_unknowns[:, 3:, 9:] = turned @ attached[0]
        if self.eye_in_hand:
            inverse = self._inverse_derivative(poses, state)
            by_errors, by_unknowns = inverse @ by_errors, inverse @ by_unknowns
        return by_errors, by_unknowns

    def _inverse_derivative(self, poses: LinkPoses, state: Array) -> Array:
        """Return the derivatives (M, 6, 6) of the inverse poses by the poses."""
        rotation, position = self._predicted(poses, state)
        result = np.zeros((len(position), 6, 6))
        result[:, :3, :3] = -rotation
        forward = -np.einsum('mji,mj->mi', rotation, position)  # of the pose before inversion
        result[:, :3, 3:] = -rotation @ cross_matrix(forward)
        result[:, 3:, 3:] = -rotation
        return result

    def _predicted(self, poses: LinkPoses, state: Array) -> tuple[Array, Array]:
        base, translation, (turn, place) = _split_poses(state)
        position = (poses.position + poses.rotation @ place) @ base.T + translation
        rotation = base @ poses.rotation @ turn
        if not self.eye_in_hand:
            return rotation, position
        rotation = np.swapaxes(rotation, 1, 2)
        return rotation, -np.einsum('mij,mj->mi', rotation, position)

    def _filled(self) -> Array:
        return np.where(self.seen[:, None, None], self.rotation, np.eye(3))

    def linear(self, poses: LinkPoses, rotation: Array) -> tuple[float, Array]:
        """Return the least squared residual and the best state for a base rotation (3, 3)."""
        seen = self.seen
        measured, place = self._filled(), np.where(seen[:, None], self.position, 0.0)
        if self.eye_in_hand:
            measured = np.swapaxes(measured, 1, 2)
            place = -np.einsum('mij,mj->mi', measured, place)
        turned = rotation @ poses.rotation
        attached = Rotation.from_matrix(
            np.swapaxes(turned[seen], 1, 2) @ measured[seen]
        ).mean().as_matrix()  # fmt: skip
        misfit = np.sum((turned[seen] @ attached - measured[seen]) ** 2)
        matrix = np.zeros((int(seen.sum()), 3, 6))
        matrix[:, :, :3] = np.eye(3)
        matrix[:, :, 3:] = turned[seen]
        value = (place - poses.position @ rotation.T)[seen].ravel()
        flat = matrix.reshape(-1, 6)
        solution = np.linalg.lstsq(flat, value, rcond=1e-9)[0]
        cost = float(np.sum((flat @ solution - value) ** 2) + misfit * np.var(place))
        state = [rotation.ravel(), solution[:3], attached.ravel(), solution[3:]]
        return cost, np.concatenate(state)

    def moved(self, state: Array, step: Array) -> Array:
        """Return the state changed by a step (U,) of base frame and attached frame."""
        moved = _moved_base(state, step[:6])
        moved[21:] += step[6:9]
        turn = Rotation.from_rotvec(step[9:]).as_matrix()
        moved[12:21] = (state[12:21].reshape(3, 3) @ turn).ravel()
        return moved

    def rows(self, index: npt.NDArray[Any]) -> Self:
        """Return a source that contains only the postures `index`."""
        return replace(self, rotation=self.rotation[index], position=self.position[index])

    @property
    def seen(self) -> Mask:
        """Mask (M,) of postures with a measured position and rotation."""
        turned = np.isfinite(self.rotation).all(axis=(1, 2))
        return np.asarray(np.isfinite(self.position).all(axis=1) & turned)


Source = MarkerSource | PoseSource
"""Measurements of one sensor in M postures."""


def register(source: Source, poses: LinkPoses) -> Array:
    """Return the initial state (S,) of a source, from measurements and nominal poses."""
    rows = np.flatnonzero(source.seen)
    some = rows[np.unique(np.linspace(0, len(rows) - 1, _REGISTERED).astype(int))]
    part = source.rows(some)
    poses = LinkPoses(poses.rotation[some], poses.position[some], poses.jacobian[some])
    return _best_start(lambda rotation: part.linear(poses, rotation))


def sigma(source: Source, length: float, angle: float) -> Array:
    """Return each residual's noise (K,), which depends on whether it is a length or angle."""
    return np.array([length if unit == 'm' else angle for _, unit in source.channels])


def norms(sources: Sequence[Source], residuals: Sequence[Array], unit: str) -> dict[str, Array]:
    """Return the vector norm (M,) of each marker's or body's residuals that have this unit."""
    groups: dict[str, list[Array]] = {}
    for source, residual in zip(sources, residuals, strict=True):
        for (channel, own), column in zip(source.channels, residual.T, strict=True):
            if own == unit:
                groups.setdefault(channel.rpartition(' ')[0], []).append(column)
    return {name: np.asarray(np.linalg.norm(own, axis=0)) for name, own in groups.items()}


@dataclass(frozen=True, eq=False)
class Observations:
    """Postures of an arm at rest, with sensor measurements.

    Attributes
    ----------
    q : (M, n) ndarray
        Recorded joint positions [rad].
    sources : tuple of Source
        Sources with M postures each.
    labels : tuple of M str
        Name of each posture in messages, for example 'row 12'.
    """

    q: Array
    sources: tuple[Source, ...]
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Assign numbers as labels to postures without a label."""
        if not self.labels:
            names = tuple(f'posture {k + 1}' for k in range(len(self.q)))
            object.__setattr__(self, 'labels', names)

    def __len__(self) -> int:
        """Return the number of postures."""
        return len(self.q)

    def rows(self, index: Sequence[int] | npt.NDArray[Any]) -> Observations:
        """Return observations that contain only the postures `index`."""
        places = np.asarray(index)
        if places.dtype == bool:
            places = np.flatnonzero(places)
        labels = tuple(self.labels[k] for k in places)
        sources = tuple(source.rows(places) for source in self.sources)
        return Observations(self.q[places], sources, labels)


def base_pose(state: Array) -> tuple[Array, Array]:
    """Return rotation (3, 3) and translation (3,) [m] of the base in the sensor's frame."""
    return state[:9].reshape(3, 3), state[9:12]


def _base_names(source: Source) -> tuple[str, ...]:
    return tuple(f'{source.name}.base.{axis}' for axis in _AXES)


def _split_poses(state: Array) -> tuple[Array, Array, tuple[Array, Array]]:
    return *base_pose(state), (state[12:21].reshape(3, 3), state[21:])


def _moved_base(state: Array, step: Array) -> Array:
    """Return a copy of a source's state with the base frame displaced and rotated by `step`."""
    moved = state.copy()
    turn = Rotation.from_rotvec(step[3:]).as_matrix()
    moved[:9] = (turn @ state[:9].reshape(3, 3)).ravel()
    moved[9:12] += step[:3]
    return moved


def _best_start(linear: Callable[[Array], tuple[float, Array]]) -> Array:
    """Return the source's state with the least residual, found from random base rotations."""
    generator = np.random.default_rng(0)
    starts = Rotation.random(_STARTS, rng=generator)
    best = min((linear(rotation) for rotation in starts.as_matrix()), key=lambda one: one[0])
    spread = _SPREAD
    for _ in range(_REFINED):
        turns = Rotation.from_rotvec(spread * generator.normal(size=(30, 3)) / np.sqrt(3.0))
        near = turns * Rotation.from_matrix(best[1][:9].reshape(3, 3))
        found = min((linear(rotation) for rotation in near.as_matrix()), key=lambda one: one[0])
        best = min(best, found, key=lambda one: one[0])
        spread *= 0.6
    return np.asarray(best[1])


def _turned(angular: Array, lever: Array) -> Array:
    """Return the cross products (M, 3, P) of vectors (M, 3, P) with levers (M, 3)."""
    return np.cross(angular, lever[:, :, None], axis=1)


def cross_matrix(vector: Array) -> Array:
    """Return the matrices (M, 3, 3) of cross products with vectors (M, 3)."""
    zero = np.zeros(len(vector))
    x, y, z = vector.T
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
