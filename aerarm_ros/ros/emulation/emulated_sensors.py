"""Emulated motion capture and emulated camera, which observe the simulated arm."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.node import Node

from aerarm_msgs_py.topics import RELIABLE
from aerarm_ros.ros.emulation.flying_drone import fill_quaternion, fill_vector, to_time
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.simulation.arm_plant import ArmPlant
from aerarm_ros.simulation.flying_plant import FreeBasePlant
from aerarm_ros.simulation.mocap import (
    CameraSettings,
    EmulatedCamera,
    EmulatedMocap,
    MocapSettings,
    quaternion_of,
)
from aerarm_ros.simulation.sensors import DelayedSensor

SENSOR_PARAMETERS = (
    Parameter(
        'geometry_seed',
        -1,
        "seed of the emulated arm's geometric errors in joint zeros (10 mrad), lengths (1 mm), "
        'mounting and IMU; -1 for an arm without geometric errors',
        minimum=-1,
        maximum=10**9,
    ),
    Parameter(
        'hardware_config',
        '',
        'configuration file of the emulated arm, if it must differ from the parameter config, for '
        'example from a calibrated one; if empty, that of config',
    ),
    Parameter(
        'hardware_urdf',
        '',
        'URDF of the emulated arm, if it must differ from the parameter urdf, for example from a '
        'calibrated one; if empty, that of urdf',
    ),
    Parameter(
        'mocap_rate',
        0.0,
        'rate of an emulated motion capture. It publishes four markers of the last link '
        '(mocap/marker1 ...) and the pose of the moving base or drone (mocap/drone). 0 for none',
        'Hz',
        0.0,
        1000.0,
    ),
    Parameter(
        'mocap_noise',
        0.2e-3,
        'noise of the emulated motion capture: standard deviation of a marker position per axis',
        'm',
        0.0,
        0.1,
    ),
    Parameter(
        'mocap_clock',
        0.0,
        'offset that the emulated motion capture adds to the stamps of its messages',
        's',
        -10.0,
        10.0,
    ),
    Parameter(
        'camera_rate',
        0.0,
        'rate of an emulated camera, which publishes the pose of an optical marker on the last '
        'link (camera/marker); 0 for none',
        'Hz',
        0.0,
        1000.0,
    ),
    Parameter(
        'camera_noise',
        0.15,
        "noise of the emulated camera: standard deviation of a marker corner's image coordinates",
        'px',
        0.0,
        10.0,
    ),
)
_DEPTH = 0.02  # [s] age of a frame when it is published


class EmulatedSensors:
    """Publish measurements of the emulated motion capture and the emulated camera.

    Parameters
    ----------
    node
        Owner of the publishers.
    plant
        Simulated arm that both sensors observe.
    link
        Name of the last link.
    values
        Values of `SENSOR_PARAMETERS`, with `period` and `seed`.
    """

    def __init__(self, node: Node, plant: ArmPlant, link: str, values: SimpleNamespace) -> None:
        self._node = node
        self._clock_ns = round(1e9 * values.mocap_clock)
        self._mocap: DelayedSensor[Any] | None = None
        self._camera: DelayedSensor[Any] | None = None
        self._markers: list[Any] = []
        self._pose: Any = None
        self._body: DelayedSensor[Any] | None = None
        self._drone: Any = None
        seed = max(values.seed, 0)
        if values.mocap_rate > 0.0:
            mocap = EmulatedMocap(link, seed, MocapSettings(noise=values.mocap_noise))
            self._mocap = DelayedSensor(
                lambda: mocap.read(plant), values.mocap_rate, values.period, _DEPTH
            )
            self._markers = [
                node.create_publisher(PointStamped, f'mocap/{name}', RELIABLE)
                for name in mocap.names
            ]
            if isinstance(plant, FreeBasePlant):
                self._body = DelayedSensor(
                    lambda: mocap.read_body(plant), values.mocap_rate, values.period, _DEPTH
                )
                self._drone = node.create_publisher(PoseStamped, 'mocap/drone', RELIABLE)
        if values.camera_rate > 0.0:
            settings = CameraSettings(pixel_noise=values.camera_noise)
            camera = EmulatedCamera(link, seed, settings)
            self._camera = DelayedSensor(
                lambda: camera.read(plant), values.camera_rate, values.period, _DEPTH
            )
            self._pose = node.create_publisher(PoseStamped, 'camera/marker', RELIABLE)

    def update(self, stamp_ns: int) -> None:
        """Sample the sensors in the cycle with the stamp `stamp_ns` [ns]; publish measurements."""
        if self._mocap is not None and (sample := self._mocap.update(stamp_ns)) is not None:
            self._publish_markers(*sample)
        if self._body is not None and (sample := self._body.update(stamp_ns)) is not None:
            self._publish_pose(self._drone, 'mocap', sample[0] + self._clock_ns, sample[1])
        if self._camera is not None and (sample := self._camera.update(stamp_ns)) is not None:
            self._publish_pose(self._pose, 'camera', *sample)

    def destroy(self) -> None:
        """Destroy the publishers."""
        for publisher in (*self._markers, self._pose, self._drone):
            if publisher is not None:
                self._node.destroy_publisher(publisher)

    def _publish_markers(self, stamp_ns: int, frame: Any) -> None:
        for publisher, position in zip(self._markers, frame, strict=True):
            if not np.isfinite(position).all():
                continue  # hidden marker: a motion capture publishes no pose
            message = PointStamped()
            message.header.frame_id = 'mocap'
            message.header.stamp = to_time(stamp_ns + self._clock_ns)
            fill_vector(message.point, position)
            publisher.publish(message)

    @staticmethod
    def _publish_pose(publisher: Any, frame: str, stamp_ns: int, pose: Any) -> None:
        if pose is None:
            return  # the camera does not see the marker
        rotation, place = pose
        message = PoseStamped()
        message.header.frame_id = frame
        message.header.stamp = to_time(stamp_ns)
        fill_vector(message.pose.position, place)
        fill_quaternion(message.pose.orientation, quaternion_of(rotation))
        publisher.publish(message)
