"""Subscriptions to rotor commands, odometry and IMU, whose messages a loop reads serialized."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.flight.flight_state import OdometrySample
from aerarm_ros.motion.signals import Array
from aerarm_ros.ros.states.state_stream import (
    Answers,
    decoded_imu,
    decoded_odometry,
    decoded_rotors,
)


class RotorCommands:
    """Read thrusts from `rotor_command`, in the order of the drone's rotors.

    Parameters
    ----------
    node
        Owner of the subscription.
    names
        Names of the drone's n rotors, in the order of all arrays.
    reject
        Called with the reason why a message is rejected.
    """

    def __init__(self, node: Node, names: Sequence[str], reject: Callable[[str], None]) -> None:
        self._names = tuple(names)
        self._cdr = JointStateCdr(self._names)
        self._reject = reject
        self.reader = RawReader(node, topics.ROTOR_COMMAND)

    def newest(self) -> tuple[int, Array] | None:
        """Return stamp [ns] and thrusts (n,) [N] of the newest unread command, or None."""
        message = self.reader.take_newest()
        if message is None:
            return None
        try:
            return self._decode(message[0])
        except ValueError as error:
            self._reject(f'rotor_command: {error}')
            return None

    def destroy(self) -> None:
        """Destroy the subscription."""
        self.reader.destroy()

    def _decode(self, payload: bytes) -> tuple[int, Array]:
        names, stamp_ns, thrust = decoded_rotors(self._cdr, payload)
        if sorted(names) != sorted(self._names):
            raise ValueError(
                f'the message contains the rotors {", ".join(names) or "without names"}, but the '
                f'drone of drone_file has the rotors {", ".join(self._names)}: use the same '
                'drone_file for this node and the flight controller'
            )
        thrust = thrust[[names.index(name) for name in self._names]]
        if not np.all(np.isfinite(thrust)):
            raise ValueError('a rotor thrust is NaN or infinite: check the flight controller')
        return stamp_ns, thrust


_ODOMETRY, _IMU = 0, 1


class FlightStream:
    """Receive odometry and IMU messages of a drone.

    Parameters
    ----------
    node
        Owner of the subscriptions.
    reject
        Called with the reason why a message is rejected.
    """

    def __init__(self, node: Node, reject: Callable[[str], None]) -> None:
        self._reader = RawReader(node, topics.ODOMETRY, topics.IMU)
        self._reject = reject
        self.answers = Answers()
        """Messages that answer the odometry; they are re-sent if the odometry is re-sent."""
        self.frame = ''
        """Name of the frame of the poses in the odometry, '' before the first message."""

    def wait(self, timeout: float) -> bool:
        """Wait up to `timeout` [s] for a message; return False after a time-out or stop signal."""
        return self._reader.wait(timeout)

    def newest_odometry(self) -> tuple[int, OdometrySample | None] | None:
        """Return stamp [ns] and sample of the newest unread odometry, None without a message.

        For invalid content, the method reports the rejection and returns None as sample.
        """
        raw = self._reader.take_newest(_ODOMETRY)
        if raw is None:
            return None
        self.answers.begin(raw[0])
        message = decoded_odometry(raw[0], self._reject)
        if message is None:
            return None
        self.frame = message.header.frame_id
        return checked_odometry(message, self._reject)

    def imu_samples(self) -> list[ImuSample]:
        """Return all unread IMU samples, and report and skip invalid samples."""
        samples = []
        while (raw := self._reader.take(_IMU)) is not None:
            sample = decoded_imu(raw[0], self._reject)
            samples += [] if sample is None else [sample]
        return samples

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()


def checked_odometry(
    message: Odometry, reject: Callable[[str], None]
) -> tuple[int, OdometrySample | None]:
    """Return stamp [ns] and sample of an odometry message; an invalid sample is None."""
    stamp = message.header.stamp
    stamp_ns = stamp.sec * 1_000_000_000 + stamp.nanosec
    try:
        return stamp_ns, to_odometry_sample(message)
    except RejectedInputError as error:
        reject(str(error))
        return stamp_ns, None


def to_odometry_sample(message: Odometry) -> OdometrySample:
    """Convert an odometry message to a checked sample; raises RejectedInputError."""
    pose, twist, stamp = message.pose.pose, message.twist.twist, message.header.stamp
    p, q, v, w = pose.position, pose.orientation, twist.linear, twist.angular
    return OdometrySample(
        stamp.sec + 1e-9 * stamp.nanosec,
        np.array([p.x, p.y, p.z]),
        np.array([q.x, q.y, q.z, q.w]),
        np.array([v.x, v.y, v.z]),
        np.array([w.x, w.y, w.z]),
    )
