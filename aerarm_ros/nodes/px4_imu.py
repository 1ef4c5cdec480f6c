"""Convert the sensor topics of PX4 to the topic `imu` (sensor_msgs/Imu); needs px4_msgs.

PX4's uXRCE-DDS bridge publishes in a forward-right-down body frame and a north-east-down world
frame. The topic `imu` has a forward-left-up body frame and an east-north-up world frame. With
MAVROS this node is not needed: remap the MAVROS topic imu/data to imu.
"""

import time
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import rclpy
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_ros.control.base.base_motion import attitude_ned_frd_to_enu_flu, frd_to_flu
from aerarm_ros.ros.diagnostics import PERIOD, DiagnosticsPublisher
from aerarm_ros.ros.executors import create_steady_timer, run_until_stopped
from aerarm_ros.ros.messages import imu_message
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.parameters.parameter_table import ParameterTable
from aerarm_ros.ros.process.node_main import run_node
from aerarm_ros.ros.states.arm_clock import ArmClock

NAME = 'px4_imu'
# [s] An older attitude is not published, because its direction of gravity could be wrong.
_ATTITUDE_AGE = 0.2
PARAMETERS = ParameterTable(
    Parameter('sensor_topic', '/fmu/out/sensor_combined',
        'topic with angular velocity and acceleration, of type px4_msgs/SensorCombined'),
    Parameter('attitude_topic', '/fmu/out/vehicle_attitude',
        'topic with the attitude of the drone, of type px4_msgs/VehicleAttitude'),
)  # fmt: skip


class Px4Imu:
    """Node that publishes one `imu` message per SensorCombined message, with the newest attitude.

    If no attitude has arrived for 0.2 s, the `imu` messages state that they contain no attitude.
    /diagnostics contains the numbers of received messages.

    Raises
    ------
    ValueError
        If px4_msgs is not installed.
    """

    def __init__(self) -> None:
        if find_spec('px4_msgs') is None:
            raise ValueError(
                'px4_msgs is not installed: build px4_msgs in the workspace and source the '
                'workspace, or use MAVROS and remap its topic imu/data to imu'
            )
        from px4_msgs.msg import SensorCombined, VehicleAttitude

        self.status = 0
        self._node = rclpy.create_node(NAME)
        values = PARAMETERS.declare(self._node)
        self._attitude: list[float] | None = None
        self._attitude_time = 0.0
        self._samples = self._attitudes = 0
        self._reported = (0, 0)
        self._imu = topics.IMU.publisher(self._node)
        for kind, topic, act in (
            (SensorCombined, values.sensor_topic, self._on_sensor),
            (VehicleAttitude, values.attitude_topic, self._on_attitude),
        ):
            self._node.create_subscription(kind, topic, act, qos_profile_sensor_data)
        self._topics = (values.sensor_topic, values.attitude_topic)
        self._clock = ArmClock(self._node)
        self._diagnostics = DiagnosticsPublisher(self._node)
        create_steady_timer(self._node, PERIOD, self._report)

    def run(self) -> None:
        """Convert messages until SIGINT, SIGTERM, SIGHUP or a shutdown."""
        run_until_stopped(self._node)

    def close(self) -> None:
        """Destroy the node."""
        self._node.destroy_node()

    def _on_attitude(self, message: Any) -> None:
        self._attitudes += 1
        w, x, y, z = (float(value) for value in message.q)
        self._attitude, self._attitude_time = [x, y, z, w], time.monotonic()

    def _on_sensor(self, message: Any) -> None:
        self._samples += 1
        stamp = Time(nanoseconds=self._clock.now_ns()).to_msg()
        if time.monotonic() - self._attitude_time > _ATTITUDE_AGE:
            self._attitude = None
        self._imu.publish(
            to_imu(stamp, self._attitude, message.gyro_rad, message.accelerometer_m_s2)
        )

    def _report(self) -> None:
        counts = (self._samples, self._attitudes)
        silent = [
            topic
            for topic, count, before in zip(self._topics, counts, self._reported, strict=True)
            if count == before
        ]
        self._reported = counts
        problem = (
            f'no messages received on {" and ".join(silent)}: check that the uXRCE-DDS agent runs'
        )
        values = {'samples': counts[0], 'attitudes': counts[1]}
        self._diagnostics.report(problem if silent else '', values)


def to_imu(
    stamp: Any,
    attitude: Sequence[float] | None,
    angular_velocity: Sequence[float],
    specific_force: Sequence[float],
) -> Imu:
    """Convert a PX4 sample to an Imu message.

    Parameters
    ----------
    stamp
        builtin_interfaces/Time
    attitude
        (4,) quaternion (x, y, z, w), forward-right-down in north-east-down; None if unknown.
    angular_velocity, specific_force
        (3,) forward-right-down [rad/s], [m/s^2].
    """
    turned = None if attitude is None else attitude_ned_frd_to_enu_flu(attitude)
    rate, force = frd_to_flu(angular_velocity), frd_to_flu(specific_force)
    return imu_message(Header(stamp=stamp), turned, rate, force)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, Px4Imu, args, PARAMETERS, __doc__)
