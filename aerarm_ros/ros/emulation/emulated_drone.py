"""The drone that carries the simulated arm and moves as told: its IMU on topic imu."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Imu

from aerarm_msgs_py import topics
from aerarm_ros.ros.states.arm_modes import HELD
from aerarm_ros.simulation.delayed_sensor import DelayedSensor
from aerarm_ros.simulation.faulty_imu import ImuReading
from aerarm_ros.simulation.free_base_plant import FreeBasePlant
from aerarm_ros.simulation.moving_base_plant import MovingBasePlant


class EmulatedDrone:
    """Moves once the arm's motors hold it, and tells what its IMU reads.

    Parameters
    ----------
    node
        Owner of the publisher.
    plant
        The arm on its base.
    imu
        The IMU on that base.
    imu_frame
        Name of the IMU's frame.
    """

    def __init__(
        self,
        node: Node,
        plant: FreeBasePlant,
        imu: DelayedSensor[ImuReading],
        imu_frame: str,
    ) -> None:
        self._node = node
        self._plant = plant
        self._imu = imu
        self._publisher = node.create_publisher(Imu, topics.IMU.name, topics.IMU.offered)
        self._message = Imu()
        self._message.header.frame_id = imu_frame
        self._is_moving = False

    def update(self, mode: str, stamp_ns: int) -> None:
        """Take the bridge's mode and the stamp of its cycle [ns], and publish what is due."""
        if not self._is_moving and mode in HELD:
            self._is_moving = True
            if isinstance(self._plant, MovingBasePlant):
                self._plant.start()
        sample = self._imu.update(stamp_ns)
        if sample is not None:
            self._publish(*sample)

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)

    def _publish(self, stamp_ns: int, reading: ImuReading) -> None:
        attitude, rate, force = reading
        message = self._message
        message.header.stamp = to_time(stamp_ns)
        fill_quaternion(message.orientation, attitude)
        fill_vector(message.angular_velocity, rate)
        fill_vector(message.linear_acceleration, force)
        self._publisher.publish(message)


def to_time(stamp_ns: int) -> Time:
    """Return a message's stamp of a time [ns]."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def fill_vector(part: Any, vector: NDArray[Any]) -> None:
    """Write (3,) numbers to x, y and z of a part of a message."""
    part.x, part.y, part.z = vector.tolist()


def fill_quaternion(part: Any, quaternion: NDArray[Any]) -> None:
    """Write a quaternion (x, y, z, w) to a part of a message."""
    part.x, part.y, part.z, part.w = quaternion.tolist()
