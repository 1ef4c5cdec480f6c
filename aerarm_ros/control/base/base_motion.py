"""Motion of the arm's base (gravity, acceleration, angular velocity), and samples of its IMU.

PX4 and ArduPilot use north-east-down for the world and forward-right-down for the body; ROS uses
east-north-up and forward-left-up (REP 103, REP 105). MAVROS converts the axes.

Quaternions are (x, y, z, w), as in ROS messages, and rotate from body to world.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import STANDARD_GRAVITY, Robot
from aerarm_ros.motion.signals import Array

_HALF = np.sqrt(0.5)
# Body: half a turn about x. World: x and y swapped, z reversed.
_FLU_IN_FRD = np.array([1.0, 0.0, 0.0, 0.0])
_NED_IN_ENU = np.array([_HALF, _HALF, 0.0, 0.0])


def frd_to_flu(vector: npt.ArrayLike) -> Array:
    """Convert a vector (3,) between forward-right-down and forward-left-up body axes."""
    return np.asarray(vector, dtype=float) * (1.0, -1.0, -1.0)


def attitude_ned_frd_to_enu_flu(quaternion: npt.ArrayLike) -> Array:
    """Convert an attitude quaternion (4,) from PX4's axes to ROS axes (ENU, FLU).

    Parameters
    ----------
    quaternion : (4,) array_like
        Attitude (x, y, z, w) of the forward-right-down body in the north-east-down world.
    """
    q = np.asarray(quaternion, dtype=float)
    return quaternion_product(quaternion_product(_NED_IN_ENU, q), _FLU_IN_FRD)


def quaternion_product(a: Array, b: Array) -> Array:
    """Return the product a b of two quaternions (x, y, z, w), which rotates by b, then by a."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def rotation_matrix(quaternion: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion (x, y, z, w)."""
    return np.array(pin.Quaternion(np.asarray(quaternion, dtype=float)).matrix())


def quaternion(rotation: Array) -> Array:
    """Return the unit quaternion (x, y, z, w) of a rotation matrix (3, 3)."""
    return np.array(pin.Quaternion(rotation).coeffs())


# Larger values indicate a wrong unit: 30 g, 6 turns per second.
_SPECIFIC_FORCE_MAX = 300.0
_ANGULAR_VELOCITY_MAX = 40.0


@dataclass(frozen=True, eq=False)
class ImuSample:
    """Validated IMU sample, in the axes of the IMU, with the conventions of sensor_msgs/Imu.

    Attributes
    ----------
    stamp : float
        Time of the sample [s].
    attitude : (4,) ndarray or None
        Quaternion (x, y, z, w), from the IMU to a world with z up, normalized; None if the IMU has
        no attitude.
    angular_velocity : (3,) ndarray
        [rad/s]
    specific_force : (3,) ndarray
        Acceleration minus gravity [m/s^2]: about +9.81 along the upward axis at rest.

    Raises
    ------
    RejectedInputError
        If a number is not finite, the quaternion is nearly zero, or a value is too large for the
        expected unit.
    """

    stamp: float
    attitude: Array | None
    angular_velocity: Array
    specific_force: Array

    def __post_init__(self) -> None:
        """Check that every value of the sample is finite and plausible."""
        numbers = [self.stamp, *self.angular_velocity, *self.specific_force]
        if self.attitude is not None:
            numbers += [*self.attitude]
        if not np.all(np.isfinite(numbers)):
            raise RejectedInputError('IMU: a value is NaN or infinite; check the driver')
        for what, vector, largest, unit in (
            ('acceleration', self.specific_force, _SPECIFIC_FORCE_MAX, 'm/s^2'),
            ('angular velocity', self.angular_velocity, _ANGULAR_VELOCITY_MAX, 'rad/s'),
        ):
            if np.linalg.norm(vector) > largest:
                raise RejectedInputError(
                    f'IMU: the {what} is above {largest:g} {unit}; check its unit'
                )
        if self.attitude is not None:
            norm = float(np.linalg.norm(self.attitude))
            if not 0.9 < norm < 1.1:
                raise RejectedInputError(
                    f'IMU: the orientation quaternion has length {norm:.3g} instead of 1; if the '
                    'IMU has no attitude, set orientation_covariance[0] to -1'
                )
            object.__setattr__(self, 'attitude', self.attitude / norm)


class BaseMotion(NamedTuple):
    """Motion of the origin of the arm's base frame, with all vectors in base axes.

    Attributes
    ----------
    gravity : (3,) ndarray
        Gravity [m/s^2].
    specific_force : (3,) ndarray
        Acceleration of the base's origin minus gravity [m/s^2], as an accelerometer measures it.
        At rest it is `-gravity`.
    angular_velocity, angular_acceleration : (3,) ndarray
        Angular velocity [rad/s] and angular acceleration [rad/s^2] of the base.
    """

    gravity: Array
    specific_force: Array
    angular_velocity: Array
    angular_acceleration: Array

    @classmethod
    def still(cls, gravity_in_base: npt.ArrayLike) -> 'BaseMotion':
        """Return the motion of an unaccelerated base under `gravity_in_base` [m/s^2]."""
        gravity = np.array(gravity_in_base, dtype=float)
        return cls(gravity, -gravity, np.zeros(3), np.zeros(3))


_GRAVITY_IN_WORLD = np.array(STANDARD_GRAVITY)


@dataclass(frozen=True, eq=False)
class Mount:
    """Position and orientation of the IMU in the arm's base frame.

    Attributes
    ----------
    rotation_imu_to_base : (3, 3) ndarray
    imu_position_in_base : (3,) ndarray
        Position of the IMU in the arm's base frame [m].
    """

    rotation_imu_to_base: Array
    imu_position_in_base: Array

    @classmethod
    def aligned(cls) -> 'Mount':
        """Return the mount of an IMU whose frame coincides with the arm's base frame."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_drone(cls, drone: DroneConfig) -> 'Mount':
        """Return the mount of the IMU as the drone file describes it."""
        base, imu = drone.mount, drone.imu
        to_base = base.rotation.T
        offset = np.array(imu.position) - base.position
        return cls(to_base @ imu.rotation, to_base @ offset)

    @classmethod
    def from_robot(cls, robot: Robot, imu_frame: str) -> 'Mount':
        """Return the mount of an IMU whose frame is a URDF link that is fixed to the base.

        Raises
        ------
        ValueError
            If the URDF has no such link, or the link moves with the arm.
        """
        model, imu_frame = robot.model, robot.full_name(imu_frame)
        if not model.existFrame(imu_frame):
            names = ', '.join(frame.name for frame in model.frames if frame.parentJoint == 0)
            raise ValueError(
                f'link {imu_frame!r} (imu_frame) is not in the URDF: name a link that is fixed '
                f'to the base, one of {names}'
            )
        frame = model.frames[model.getFrameId(imu_frame)]
        if frame.parentJoint != 0:
            raise ValueError(
                f'link {imu_frame!r} (imu_frame) moves with the arm: name a link that is '
                'fixed to the base'
            )
        placement = frame.placement
        return cls(np.array(placement.rotation), np.array(placement.translation))

    def gravity_in_base(self, attitude: Array) -> Array:
        """Return gravity (3,) [m/s^2] in base axes, given the IMU attitude (x, y, z, w)."""
        gravity: Array = self.rotation_imu_to_base @ (
            rotation_matrix(attitude).T @ _GRAVITY_IN_WORLD
        )
        return gravity

    def acceleration_of_base(self, rate: Array, spin: Array) -> Array:
        """Return the base origin's acceleration relative to the IMU, (3,) [m/s^2].

        Parameters
        ----------
        rate, spin : (3,) ndarray
            Angular velocity [rad/s] and acceleration [rad/s^2], all in base axes.
        """
        # spin x r + rate x (rate x r) in scalars, because numpy's cross takes ten times as long.
        (u, v, w), (x, y, z) = spin.tolist(), (-self.imu_position_in_base).tolist()
        a, b, c = rate.tolist()
        along, square = a * x + b * y + c * z, a * a + b * b + c * c
        return np.array(
            [
                v * z - w * y + a * along - x * square,
                w * x - u * z + b * along - y * square,
                u * y - v * x + c * along - z * square,
            ]
        )
