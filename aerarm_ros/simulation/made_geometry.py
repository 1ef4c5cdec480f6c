"""Random geometry errors of a manufactured arm, for simulations of its calibration.

The module shares no code with the calibration: rotations are computed from their formulas, and
link poses by the physics engine.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, sin
from xml.etree import ElementTree

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drone_config import DroneConfig, PoseConfig
from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.motion.signals import Array

# Standard deviations: of the joints' zeros [rad], of a joint's position per axis [m] and direction
# [rad], and the same of the arm's base on its vehicle and of the IMU on the drone.
_OFFSET, _LENGTH, _TILT = 0.010, 1e-3, 2e-3
_MOUNT_LENGTH, _MOUNT_TILT = 3e-3, 0.02
_IMU_LENGTH, _IMU_TILT = 2e-3, 0.01


@dataclass(frozen=True, eq=False)
class MadeGeometry:
    """Geometry of a manufactured arm: errors of joints, encoder zeros, mount and IMU.

    Attributes
    ----------
    robot : Robot
        Arm with displaced joints.
    offsets : (n,) ndarray
        True joint position minus the position computed with the drawn configuration [rad].
    mount_shift, mount_turn, imu_shift, imu_turn : (3,) ndarray
        Displacement [m] and rotation vector [rad] of the arm's base and the IMU on the vehicle.
    """

    robot: Robot
    offsets: Array
    mount_shift: Array
    mount_turn: Array
    imu_shift: Array
    imu_turn: Array

    @classmethod
    def of(cls, robot: Robot, seed: int) -> MadeGeometry:
        """Return an arm with normally distributed errors."""
        random = np.random.default_rng([seed, 37])
        n = robot.n
        shifts = _LENGTH * random.standard_normal((n, 3))
        turns = _TILT * random.standard_normal((n, 3))
        text = displaced_urdf(robot.urdf_text, robot.joint_names, shifts, turns)
        made = load_robot(
            text, gravity_in_base=robot.gravity_in_base, joint_names=robot.joint_names
        )
        # The names already have their prefix.
        made = replace(made, prefix=robot.prefix, path=robot.path)
        return cls(
            made,
            _OFFSET * random.standard_normal(n),
            _MOUNT_LENGTH * random.standard_normal(3),
            _MOUNT_TILT * random.standard_normal(3),
            _IMU_LENGTH * random.standard_normal(3),
            _IMU_TILT * random.standard_normal(3),
        )

    def config(self, drawn: ArmConfig) -> ArmConfig:
        """Return a copy of the configuration with the true joint offsets."""
        joints = tuple(
            replace(joint, offset=joint.offset + float(offset))
            for joint, offset in zip(drawn.joints, self.offsets, strict=True)
        )
        return replace(drawn, joints=joints)

    def drone(self, drawn: DroneConfig) -> DroneConfig:
        """Return a copy of the drone's data with the true poses of arm mount and IMU."""
        return replace(
            drawn,
            mount=_moved(drawn.mount, self.mount_shift, self.mount_turn, drawn.size),
            imu=_moved(drawn.imu, self.imu_shift, self.imu_turn, drawn.size),
        )

    def as_dict(self) -> dict[str, object]:
        """Return the geometry errors as plain numbers for a YAML file."""
        names = ('mount_shift', 'mount_turn', 'imu_shift', 'imu_turn')
        others = {name: getattr(self, name).tolist() for name in names}
        return {'joint_offsets': self.offsets.tolist(), **others}


def displaced_urdf(text: str, joint_names: tuple[str, ...], shifts: Array, turns: Array) -> str:
    """Return a copy of a URDF with displaced joints.

    Parameters
    ----------
    text : str
        The original URDF.
    joint_names : tuple of n str
    shifts, turns : (n, 3) ndarray
        Displacement of a joint [m] and rotation about its axes [rad], in the axes of its parent
        link.
    """
    root = ElementTree.fromstring(text)
    joints = {joint.get('name'): joint for joint in root.findall('joint')}
    for name, shift, turn in zip(joint_names, shifts, turns, strict=True):
        origin = joints[name].find('origin')
        if origin is None:
            origin = ElementTree.SubElement(joints[name], 'origin')
        place = np.array([float(part) for part in origin.get('xyz', '0 0 0').split()])
        angles = [float(part) for part in origin.get('rpy', '0 0 0').split()]
        turned = rotation_about(turn) @ PoseConfig((0.0, 0.0, 0.0), tuple(angles)).rotation
        origin.set('xyz', _text(place + shift))
        origin.set('rpy', _text(angles_of(turned)))
    return ElementTree.tostring(root, encoding='unicode')


def rotation_about(vector: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector [rad], by Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sin(angle) * cross + (1.0 - cos(angle)) * cross @ cross)


def angles_of(rotation: Array) -> Array:
    """Return roll, pitch and yaw (3,) [rad] of a rotation matrix, with the convention of URDF."""
    pitch = -np.arcsin(np.clip(rotation[2, 0], -1.0, 1.0))
    if abs(np.cos(pitch)) < 1e-9:
        return np.array([0.0, pitch, np.arctan2(-rotation[0, 1], rotation[1, 1])])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def _moved(pose: PoseConfig, shift: Array, turn: Array, size: tuple[float, ...]) -> PoseConfig:
    """Return a displaced pose; its position is limited to the body's box."""
    half = 0.5 * np.array(size)
    place = np.clip(np.array(pose.position) + shift, -half, half)
    angles = angles_of(rotation_about(turn) @ pose.rotation)
    return PoseConfig(tuple(place.tolist()), tuple(angles.tolist()))


def _text(values: Array) -> str:
    return ' '.join(repr(float(value)) for value in values)
