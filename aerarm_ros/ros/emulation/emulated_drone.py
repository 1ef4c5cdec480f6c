"""The drone that carries the simulated arm: its motion, and its IMU on topic imu."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import Imu

from aerarm_msgs_py import topics
from aerarm_ros.ros.states.arm_modes import HELD
from aerarm_ros.ros.states.base_header import BASE_FRAME
from aerarm_ros.simulation.moving_base_plant import MovingBasePlant

IMU_PERIOD = 0.004
"""[s]; 250 Hz, as autopilots send it."""


class EmulatedDrone:
    """Moves once the arm's motors hold it, and tells what an ideal IMU at its base reads.

    Parameters
    ----------
    node
        Owner of the publisher.
    plant
        The arm on its moving base.
    """

    def __init__(self, node: Node, plant: MovingBasePlant) -> None:
        self._node = node
        self._plant = plant
        self._publisher = node.create_publisher(Imu, topics.IMU.name, topics.IMU.qos)
        self._message = Imu()
        self._message.header.frame_id = BASE_FRAME
        self._due = 0.0
        self._is_moving = False

    def update(self, mode: str, now: float, stamp_ns: int) -> None:
        """Take the bridge's mode, and publish if it is due at `now` [s], with a stamp [ns]."""
        if not self._is_moving and mode in HELD:
            self._is_moving = True
            self._plant.start()
        if now >= self._due:
            self._due = now + IMU_PERIOD - 0.5e-3  # cycles come with jitter
            self._publish(stamp_ns)

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._node.destroy_publisher(self._publisher)

    def _publish(self, stamp_ns: int) -> None:
        attitude, rate, force = (part.tolist() for part in self._plant.imu)
        message = self._message
        stamp, q = message.header.stamp, message.orientation
        stamp.sec, stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
        q.x, q.y, q.z, q.w = attitude
        for vector, values in (
            (message.angular_velocity, rate),
            (message.linear_acceleration, force),
        ):
            vector.x, vector.y, vector.z = values
        self._publisher.publish(message)
