"""Positions, poses and inertial measurements from a bag, by topic and frame."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerarm_msgs_py.bags.bag import Bag
from aerarm_msgs_py.codecs.cdr import CdrReader
from aerarm_msgs_py.storage.read_limits import BagError, ReadLimits

Array = NDArray[np.float64]

POINT = 'geometry_msgs/msg/PointStamped'
POSE = 'geometry_msgs/msg/PoseStamped'
TRANSFORM = 'geometry_msgs/msg/TransformStamped'
TF = 'tf2_msgs/msg/TFMessage'
ODOMETRY = 'nav_msgs/msg/Odometry'
IMU = 'sensor_msgs/msg/Imu'

_MOST = 2_000_000  # values of all series, because memory is limited
_ROW = 8 * 12  # bytes of a sample


@dataclass(eq=False)
class PoseSeries:
    """T samples of the pose or the inertial measurements of one topic or frame.

    Attributes
    ----------
    name : str
        Name of the topic; for a TFMessage, of the child frame.
    kind : str
        Message type.
    stamp, log_time : (T,) ndarray
        Stamp of the message's header, and time of reception [s].
    position : (T, 3) ndarray
        Position of each sample [m]; NaN for an Imu.
    quaternion : (T, 4) ndarray
        Orientation (x, y, z, w) of each sample; NaN for a point.
    angular_velocity, linear_acceleration : (T, 3) ndarray
        Angular velocity [rad/s] and acceleration [m/s^2] of an Imu; NaN for other types.
    """

    name: str
    kind: str
    stamp: Array
    log_time: Array
    position: Array
    quaternion: Array
    angular_velocity: Array
    linear_acceleration: Array

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.stamp)


def read_poses(
    path: Path | str,
    topics: Collection[str] = (),
    frames: Collection[str] = (),
    limits: ReadLimits | None = None,
) -> dict[str, PoseSeries]:
    """Read points, poses, transforms, odometry and inertial measurements from a bag.

    Parameters
    ----------
    path
        rosbag2 directory, .mcap or .db3 file.
    topics
        Names of the topics to read; if empty, all topics of the types above.
    frames
        Child frames to read from TFMessages; if empty, all frames.
    limits
        Limits of memory and time for reading.

    Returns
    -------
    dict of str to PoseSeries
        Series by topic, for TFMessages by child frame, each ordered by its stamps.

    Raises
    ------
    BagError
        If the bag cannot be read, or its content exceeds the memory limit.
    """
    bag = Bag(path, limits)
    wanted = {'/' + topic.lstrip('/') for topic in topics}
    found: dict[str, tuple[str, list[Array]]] = {}
    for block in bag.blocks(wanted or None):
        if block.type not in _NUMBERS:
            continue
        log_time = (block.log_time / 1e9).tolist()
        for time, payload in zip(log_time, block.payloads, strict=True):
            bag.budget.spend(_ROW)
            try:
                for name, row in _decode(payload, block.type, time):
                    if name and frames and name not in frames:
                        continue
                    _, rows = found.setdefault(name or block.topic, (block.type, []))
                    rows.append(row)
            except ValueError as error:
                raise BagError(
                    f'topic {block.topic} of the bag {path} cannot be decoded ({error}): check '
                    'that the bag is complete'
                ) from error
        if sum(len(rows) for _, rows in found.values()) > _MOST:
            raise BagError(
                f'the bag {path} contains more than {_MOST} poses: cut the bag to the motion that '
                'you need'
            )
    return {name: _series(name, kind, rows) for name, (kind, rows) in found.items()}


def _series(name: str, kind: str, rows: list[Array]) -> PoseSeries:
    values = np.array(rows)
    values = values[np.argsort(values[:, 0], kind='stable')]
    kept = np.concatenate([[True], np.diff(values[:, 0]) > 0.0])
    values = values[kept]
    return PoseSeries(name, kind, *values[:, :2].T, *np.split(values[:, 2:], _PARTS, axis=1))


_PARTS = 3, 7, 10  # first columns of quaternion, angular velocity and acceleration
# Consecutive numbers of each kind after its header; an Imu has three covariances.
_NUMBERS = {POINT: 3, POSE: 7, TRANSFORM: 7, TF: 7, ODOMETRY: 7, IMU: 28}


def _decode(payload: bytes, kind: str, log_time: float) -> Iterator[tuple[str, Array]]:
    """Yield the child frame of each pose in a message, or '', with its times and numbers."""
    reader = CdrReader(payload)
    for _ in range(reader.uint32() if kind == TF else 1):
        row = np.full(15, np.nan)
        row[:2] = reader.int32() + 1e-9 * reader.uint32(), log_time
        reader.string()  # frame
        child = reader.string() if kind in (TRANSFORM, TF, ODOMETRY) else ''
        numbers = reader.fixed_doubles(_NUMBERS[kind])
        if kind == IMU:
            row[5:9], row[9:12], row[12:] = numbers[:4], numbers[13:16], numbers[25:]
        else:
            row[2 : 2 + len(numbers)] = numbers
        yield child if kind == TF else '', row
