"""Emulated motion capture and emulated camera, which observe the simulated arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped, PoseStamped
from rclpy.node import Node

from aerarm_msgs_py.topics import RELIABLE
from aerarm_ros.ros.messages import fill
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.states.state_stream import base_header
from aerarm_ros.simulation.arm_plant import ArmPlant
from aerarm_ros.simulation.flying_plant import FreeBasePlant
from aerarm_ros.simulation.mocap import EmulatedCamera, EmulatedMocap, quaternion_of
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
        self._publishers: list[Any] = []
        # Each sensor with the function that publishes its samples.
        self._sensors: list[tuple[DelayedSensor[Any], Callable[[int, Any], None]]] = []
        seed = max(values.seed, 0)

        def add(read: Callable[[Any], Any], rate: float, publish: Callable[..., None]) -> None:
            sensor = DelayedSensor(lambda: read(plant), rate, values.period, _DEPTH)
            self._sensors.append((sensor, publish))

        if values.mocap_rate > 0.0:
            mocap = EmulatedMocap(link, seed, values.mocap_noise)
            clock_ns = round(1e9 * values.mocap_clock)
            markers = [self._publisher(PointStamped, f'mocap/{name}') for name in mocap.names]
            add(mocap.read, values.mocap_rate, partial(_publish_markers, markers, clock_ns))
            if isinstance(plant, FreeBasePlant):
                body = self._publisher(PoseStamped, 'mocap/drone')
                publish = partial(_publish_pose, body, 'mocap', clock_ns)
                add(mocap.read_body, values.mocap_rate, publish)
        if values.camera_rate > 0.0:
            camera = EmulatedCamera(link, seed, values.camera_noise)
            marker = self._publisher(PoseStamped, 'camera/marker')
            add(camera.read, values.camera_rate, partial(_publish_pose, marker, 'camera', 0))

    def update(self, stamp_ns: int) -> None:
        """Sample the sensors at the time `stamp_ns` [ns], and publish measurements that are due."""
        for sensor, publish in self._sensors:
            if (sample := sensor.update(stamp_ns)) is not None:
                publish(*sample)

    def destroy(self) -> None:
        """Destroy the publishers."""
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)

    def _publisher(self, kind: Any, topic: str) -> Any:
        publisher = self._node.create_publisher(kind, topic, RELIABLE)
        self._publishers.append(publisher)
        return publisher


def _publish_markers(publishers: Sequence[Any], clock_ns: int, stamp_ns: int, frame: Any) -> None:
    for publisher, position in zip(publishers, frame, strict=True):
        if not np.isfinite(position).all():
            continue  # hidden marker: a motion capture publishes no position
        message = PointStamped(header=base_header(stamp_ns + clock_ns, 'mocap'))
        fill(message.point, position)
        publisher.publish(message)


def _publish_pose(publisher: Any, frame: str, clock_ns: int, stamp_ns: int, pose: Any) -> None:
    if pose is None:
        return  # the camera does not see the marker
    rotation, place = pose
    message = PoseStamped(header=base_header(stamp_ns + clock_ns, frame))
    fill(message.pose.position, place)
    fill(message.pose.orientation, quaternion_of(rotation))
    publisher.publish(message)
