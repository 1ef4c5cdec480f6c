"""Convert the sensor topics of PX4 to the topic `imu` (sensor_msgs/Imu); needs px4_msgs.

PX4's uXRCE-DDS bridge publishes in a forward-right-down body frame and a north-east-down world
frame. The topic `imu` has a forward-left-up body frame and an east-north-up world frame. With
MAVROS this node is not needed: remap the MAVROS topic imu/data to imu.
"""

import time
from collections.abc import Callable, Sequence
from functools import partial
from importlib.util import find_spec
from typing import Any

import rclpy
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import Imu
from std_msgs.msg import Header

from aerarm_msgs_py import topics
from aerarm_ros.autopilot.px4 import vehicle_attitude
from aerarm_ros.control.base.base_motion import frd_to_flu
from aerarm_ros.motion.signals import Array
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
        self._attitude: Array | None = None
        self._attitude_time = 0.0
        self._counts = dict.fromkeys((values.sensor_topic, values.attitude_topic), 0)
        self._reported = dict(self._counts)
        self._imu = topics.IMU.publisher(self._node)
        for kind, topic, act in (
            (SensorCombined, values.sensor_topic, self._on_sensor),
            (VehicleAttitude, values.attitude_topic, self._on_attitude),
        ):
            take = partial(self._take, topic, act)
            self._node.create_subscription(kind, topic, take, qos_profile_sensor_data)
        self._clock = ArmClock(self._node)
        self._diagnostics = DiagnosticsPublisher(self._node)
        create_steady_timer(self._node, PERIOD, self._report)

    def run(self) -> None:
        """Convert messages until SIGINT, SIGTERM, SIGHUP or a shutdown."""
        run_until_stopped(self._node)

    def close(self) -> None:
        """Destroy the node."""
        self._node.destroy_node()

    def _take(self, topic: str, act: Callable[[Any], None], message: Any) -> None:
        self._counts[topic] += 1
        act(message)

    def _on_attitude(self, message: Any) -> None:
        self._attitude, self._attitude_time = vehicle_attitude(message), time.monotonic()

    def _on_sensor(self, message: Any) -> None:
        stamp = Time(nanoseconds=self._clock.now_ns()).to_msg()
        is_new = time.monotonic() - self._attitude_time <= _ATTITUDE_AGE
        self._imu.publish(to_imu(stamp, self._attitude if is_new else None, message))

    def _report(self) -> None:
        silent = [topic for topic, count in self._counts.items() if count == self._reported[topic]]
        self._reported = dict(self._counts)
        problem = (
            f'no messages received on {" and ".join(silent)}: check that the uXRCE-DDS agent runs'
        )
        self._diagnostics.report(problem if silent else '', self._counts)


def to_imu(stamp: Any, attitude: Array | None, sample: Any) -> Imu:
    """Convert a SensorCombined message to an Imu message with a stamp (builtin_interfaces/Time).

    `attitude` is the quaternion (x, y, z, w), forward-left-up in east-north-up; None if unknown.
    """
    rate, force = frd_to_flu(sample.gyro_rad), frd_to_flu(sample.accelerometer_m_s2)
    return imu_message(Header(stamp=stamp), attitude, rate, force)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(NAME, Px4Imu, args, PARAMETERS, __doc__)
