"""Odometry and IMU samples for a loop that takes them itself, as serialized bytes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_ros.control.base.imu_sample import ImuSample
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError
from aerarm_ros.flight.odometry_sample import OdometrySample
from aerarm_ros.ros.states.state_stream import to_imu_sample

_ODOMETRY, _IMU = 0, 1


class FlightStream:
    """Waits for what a drone's sensors say.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    reject
        Called with the reason why a message is not used.
    """

    def __init__(self, node: Node, reject: Callable[[str], None]) -> None:
        self._reader = RawReader(node, topics.ODOMETRY, topics.IMU)
        self._reject = reject
        self.frame = ''
        """Frame of the odometry's poses, '' before the first."""

    @property
    def odometry_count(self) -> int:
        """Odometry messages taken."""
        return self._reader.count(_ODOMETRY)

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; ends early, with False, on a stop signal."""
        return self._reader.wait(timeout)

    def newest_odometry(self) -> tuple[int, OdometrySample | None] | None:
        """Return the stamp [ns] and content of the newest odometry, None if there is none.

        The content is None if it cannot be used, which is reported.
        """
        message = newest_odometry(self._reader, self._reject, _ODOMETRY)
        if message is None:
            return None
        self.frame = message.header.frame_id
        return checked_odometry(message, self._reject)

    def imu_samples(self) -> list[ImuSample]:
        """Return the IMU samples that wait; faulty ones are rejected."""
        samples = []
        while (raw := self._reader.take(_IMU)) is not None:
            try:
                samples.append(to_imu_sample(deserialize_message(raw[0], Imu)))
            except RejectedInputError as error:
                self._reject(str(error))
            except RuntimeError as error:
                self._reject(f'imu: {error}')
        return samples

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()


def newest_odometry(
    reader: RawReader, reject: Callable[[str], None], index: int = 0
) -> Odometry | None:
    """Return the newest odometry that waits at a reader, None if there is none."""
    raw = reader.take_newest(index)
    try:
        return None if raw is None else deserialize_message(raw[0], Odometry)
    except RuntimeError as error:  # RMWError: no message at all
        reject(f'odometry: {error}')
        return None


def checked_odometry(
    message: Odometry, reject: Callable[[str], None]
) -> tuple[int, OdometrySample | None]:
    """Return stamp [ns] and sample of a message, None for one that cannot be used."""
    stamp = message.header.stamp
    stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
    try:
        return stamp_ns, to_odometry_sample(message)
    except RejectedInputError as error:
        reject(str(error))
        return stamp_ns, None


def to_odometry_sample(message: Odometry) -> OdometrySample:
    """Return a checked sample of a message; raises RejectedInputError."""
    pose, twist, stamp = message.pose.pose, message.twist.twist, message.header.stamp
    p, q, v, w = pose.position, pose.orientation, twist.linear, twist.angular
    return OdometrySample(
        stamp.sec + 1e-9 * stamp.nanosec,
        np.array([p.x, p.y, p.z]),
        np.array([q.x, q.y, q.z, q.w]),
        np.array([v.x, v.y, v.z]),
        np.array([w.x, w.y, w.z]),
    )
