"""Where the arm's base sits on what carries the IMU."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.frame_conversion import rotation_matrix
from aerarm_ros.description.drone_config import DroneConfig
from aerarm_ros.description.robot import STANDARD_GRAVITY, Robot

Array = npt.NDArray[np.float64]

_GRAVITY_IN_WORLD = np.array(STANDARD_GRAVITY)


@dataclass(frozen=True, eq=False)
class Mount:
    """Pose of the IMU in the arm's base frame.

    Attributes
    ----------
    rotation_imu_to_base : (3, 3) ndarray
    imu_position_in_base : (3,) ndarray
        [m]
    """

    rotation_imu_to_base: Array
    imu_position_in_base: Array

    @classmethod
    def aligned(cls) -> 'Mount':
        """Return the mount of an IMU whose frame is the arm's base frame."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_drone(cls, drone: DroneConfig) -> 'Mount':
        """Return the mount of a drone's IMU."""
        base, imu = drone.mount, drone.imu
        to_base = base.rotation.T
        offset = np.array(imu.position) - base.position
        return cls(to_base @ imu.rotation, to_base @ offset)

    @classmethod
    def from_robot(cls, robot: Robot, imu_frame: str) -> 'Mount':
        """Return the mount of an IMU whose frame is a link of the URDF fixed to the base.

        Raises
        ------
        ValueError
            If there is no such link, or it moves with the arm.
        """
        model, imu_frame = robot.model, robot.full_name(imu_frame)
        if not model.existFrame(imu_frame):
            names = ', '.join(frame.name for frame in model.frames if frame.parentJoint == 0)
            raise ValueError(f'the URDF has no link {imu_frame!r}; fixed to the base are: {names}')
        frame = model.frames[model.getFrameId(imu_frame)]
        if frame.parentJoint != 0:
            raise ValueError(f'link {imu_frame!r} moves with the arm: it can hold no base IMU')
        placement = frame.placement
        return cls(np.array(placement.rotation), np.array(placement.translation))

    def gravity_in_base(self, attitude: Array) -> Array:
        """Return gravity (3,) [m/s^2] for an attitude (x, y, z, w) of the IMU in the world."""
        gravity: Array = self.rotation_imu_to_base @ (
            rotation_matrix(attitude).T @ _GRAVITY_IN_WORLD
        )
        return gravity

    def acceleration_of_base(self, rate: Array, spin: Array) -> Array:
        """Return by how much the base's origin accelerates more than the IMU, (3,) [m/s^2].

        Parameters
        ----------
        rate, spin : (3,) ndarray
            Angular velocity [rad/s] and acceleration [rad/s^2], all in base axes.
        """
        # spin x r + rate x (rate x r) in scalars: numpy's cross costs ten times as much.
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
