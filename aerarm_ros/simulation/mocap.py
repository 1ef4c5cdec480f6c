"""Emulated motion capture system and emulated camera, which measure the pose of an arm link."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from aerarm_ros.motion.signals import Array
from aerarm_ros.simulation.arm_plant import ArmPlant
from aerarm_ros.simulation.flying_plant import FreeBasePlant, rotation_of
from aerarm_ros.simulation.made_geometry import rotation_about

# Positions of markers on a plate at the wrist, [m] in the frame of the last link.
MARKERS = ((0.10, 0.05, 0.04), (0.10, -0.05, 0.04), (0.02, 0.04, 0.055), (0.16, 0.0, 0.045))
_CAMERAS = 8  # of the motion capture, on a ring
_RING = (3.0, 1.6)  # [m] radius and height
_STEEP = 0.35  # cosine of the viewing angle below which a marker is hidden
_BODY = 0.2  # [m] between the markers of the drone
_TWO = 2  # smallest number of cameras that must see a marker
_CORNERS = ((-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5))
_ITERATIONS = 15
_FOCAL, _SIDE = 1200.0, 0.08  # focal length of the camera [px], side of the optical marker [m]


class EmulatedMocap:
    """Emulated motion capture system, which measures the positions of markers on a link.

    A marker is visible if at least two of eight cameras on a ring are in front of it. The marker's
    normal points away from the link's axis.

    Parameters
    ----------
    noise : float
        Standard deviation of a marker's position per axis [m].
    dropout : float
        Fraction of frames in which a marker is lost at random.

    Attributes
    ----------
    rotation, translation : (3, 3) and (3,) ndarray
        Pose of the world in the motion capture's frame.
    """

    def __init__(self, link: str, seed: int, noise: float = 0.2e-3, dropout: float = 0.02) -> None:
        self._link = link
        self._deviation, self._dropout = noise, dropout
        self._markers = np.array(MARKERS)
        random = np.random.default_rng([seed, 38])
        self._random = random
        self._normals = self._markers * (0.3, 1.0, 1.0)
        self._normals /= np.linalg.norm(self._normals, axis=1)[:, None]
        self.rotation = rotation_about(
            np.array([0.02, -0.03, 0.0]) * random.standard_normal(3) + (0.0, 0.0, 0.6)
        )
        self.translation = np.array([0.5, -0.2, 0.9]) + 0.1 * random.standard_normal(3)
        angles = 2.0 * np.pi * np.arange(_CAMERAS) / _CAMERAS
        ring = _RING[0] * np.array([np.cos(angles), np.sin(angles)])
        heights = _RING[1] * np.where(np.arange(_CAMERAS) % 2, 1.0, -0.6)
        self._cameras = np.column_stack([*ring, heights])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the markers."""
        return tuple(f'marker{k + 1}' for k in range(len(self._markers)))

    def true_positions(self, plant: ArmPlant) -> Array:
        """Return the true positions (K, 3) [m] of the markers in the capture system's frame."""
        rotation, place = plant.link_pose(self._link)
        in_world = place + self._markers @ rotation.T
        return np.asarray(in_world @ self.rotation.T + self.translation)

    def read(self, plant: ArmPlant) -> Array:
        """Measure the marker positions (K, 3) [m] with noise; NaN for hidden or lost markers."""
        seen = self._visible(plant)
        position = self.true_positions(plant)
        position = position + self._deviation * self._random.standard_normal(position.shape)
        lost = self._random.random(len(position)) < self._dropout
        position[~seen | lost] = np.nan
        return position

    def read_body(self, plant: FreeBasePlant) -> tuple[Array, Array]:
        """Measure rotation (3, 3) and position (3,) [m] of the arm's vehicle, with noise.

        The noise is that of a rigid body of markers with a distance of 0.2 m.
        """
        base, noise = plant.base, self._deviation
        turn = noise / _BODY * self._random.standard_normal(3)
        rotation = self.rotation @ rotation_of(base.quaternion) @ rotation_about(turn)
        place = self.rotation @ base.position + self.translation
        return rotation, place + noise * self._random.standard_normal(3)

    def _visible(self, plant: ArmPlant) -> NDArray[np.bool_]:
        rotation, place = plant.link_pose(self._link)
        markers, normals = place + self._markers @ rotation.T, self._normals @ rotation.T
        to_camera = self._cameras[None] - markers[:, None]
        to_camera /= np.linalg.norm(to_camera, axis=2)[:, :, None]
        facing = np.einsum('kci,ki->kc', to_camera, normals)
        return np.asarray((facing > _STEEP).sum(axis=1) >= _TWO)


class EmulatedCamera:
    """Emulated camera that estimates the pose of an optical marker, like an ArUco detector.

    The class projects the marker's four corners and adds noise to their pixels. Its reading is the
    pose with the least reprojection error. So depth and tilt are as uncertain as with a real
    camera.

    Parameters
    ----------
    noise : float
        Standard deviation of a corner's coordinates [px].
    eye_in_hand : bool
        Whether the camera is on the link, and the marker fixed in the world.
    """

    def __init__(
        self, link: str, seed: int, noise: float = 0.15, eye_in_hand: bool = False
    ) -> None:
        self._link = link
        self._noise = noise
        self._eye_in_hand = eye_in_hand
        self._random = np.random.default_rng([seed, 39])
        self._corners = np.array([(_SIDE * x, _SIDE * y, 0.0) for x, y in _CORNERS])
        # The marker faces a camera 1.2 m away; on a link it is turned away from the axis.
        self._on_link = rotation_about(np.array([0.2, 1.3, -0.1])), np.array([0.08, 0.0, 0.05])
        self._fixed = _looking((0.9, -0.9, 0.5), (0.1, 0.0, 0.3))

    def read(self, plant: ArmPlant) -> tuple[Array, Array] | None:
        """Measure rotation (3, 3) and position (3,) [m] of the marker in the camera's frame.

        The result is None if the marker is turned away from the camera, or behind it.
        """
        rotation, place = self.true_pose(plant)
        normal, view = rotation[:, 2], place / np.linalg.norm(place)
        if place[2] < 0.1 or float(normal @ view) > -0.25:
            return None
        corners = place + self._corners @ rotation.T
        pixels = _FOCAL * corners[:, :2] / corners[:, 2:]
        pixels += self._noise * self._random.standard_normal(pixels.shape)
        return self._solved(pixels, rotation, place)

    def true_pose(self, plant: ArmPlant) -> tuple[Array, Array]:
        """Return the true rotation and position of the marker in the camera's frame."""
        rotation, place = plant.link_pose(self._link)
        own_rotation, own_place = self._on_link
        on_link = rotation @ own_rotation, place + rotation @ own_place
        camera, marker = (on_link, self._fixed) if self._eye_in_hand else (self._fixed, on_link)
        return camera[0].T @ marker[0], camera[0].T @ (marker[1] - camera[1])

    def _solved(self, pixels: Array, rotation: Array, place: Array) -> tuple[Array, Array]:
        """Return the marker pose with the least reprojection error, by the Gauss-Newton method."""
        for _ in range(_ITERATIONS):
            turned = self._corners @ rotation.T
            corners = turned + place
            x, y, z = corners.T
            residual = (_FOCAL * corners[:, :2] / z[:, None] - pixels).ravel()
            jacobian = np.zeros((len(corners), 2, 6))
            jacobian[:, 0, 0] = jacobian[:, 1, 1] = _FOCAL / z
            jacobian[:, 0, 2], jacobian[:, 1, 2] = -_FOCAL * x / z**2, -_FOCAL * y / z**2
            jacobian[:, :, 3:] = np.cross(turned[:, None], jacobian[:, :, :3])
            step = -np.linalg.lstsq(jacobian.reshape(-1, 6), residual, rcond=None)[0]
            place = place + step[:3]
            rotation = rotation_about(step[3:]) @ rotation
            if float(np.abs(step).max()) < 1e-12:
                break
        return rotation, place


def quaternion_of(rotation: Array) -> Array:
    """Return the quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return np.roll(quaternion, -1)


def _looking(at: tuple[float, ...], towards: tuple[float, ...]) -> tuple[Array, Array]:
    """Return a pose at a first point, with the z axis towards a second point."""
    place = np.array(at)
    forward = np.array(towards) - place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward]), place
