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
KINDS = (POINT, POSE, TRANSFORM, TF, ODOMETRY, IMU)

_MOST = 2_000_000  # values of all series, because memory is limited
_COVARIANCE = 9  # numbers in each covariance of an Imu
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
        Names of the topics to read; if empty, all topics of the types in `KINDS`.
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
    found: dict[str, tuple[str, list[list[float]]]] = {}
    for block in bag.blocks(wanted or None):
        if block.type not in KINDS:
            continue
        log_time = (block.log_time / 1e9).tolist()
        for time, payload in zip(log_time, block.payloads, strict=True):
            bag.budget.spend(_ROW)
            try:
                for name, row in _decode(payload, block.type):
                    if name and frames and name not in frames:
                        continue
                    _, rows = found.setdefault(name or block.topic, (block.type, []))
                    rows.append([row[0], time, *row[1:]])
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


def _series(name: str, kind: str, rows: list[list[float]]) -> PoseSeries:
    values = np.array(rows, dtype=float)
    values = values[np.argsort(values[:, 0], kind='stable')]
    kept = np.concatenate([[True], np.diff(values[:, 0]) > 0.0])
    values = values[kept]
    return PoseSeries(name, kind, *values[:, :2].T, *np.split(values[:, 2:], _PARTS, axis=1))


_PARTS = 3, 7, 10  # first columns of quaternion, angular velocity and acceleration
_NONE = [float('nan')]


def _header(reader: CdrReader) -> float:
    stamp = reader.int32() + 1e-9 * reader.uint32()
    reader.string()
    return stamp


def _doubles(reader: CdrReader, count: int) -> list[float]:
    return reader.fixed_doubles(count).tolist()  # type: ignore[no-any-return]


def _pose(reader: CdrReader, kind: str) -> tuple[str, list[float]]:
    """Return the child frame, if any, and the numbers of a message after its stamp."""
    if kind == POINT:
        return '', [*_doubles(reader, 3), *10 * _NONE]
    child = reader.string() if kind in (TRANSFORM, TF, ODOMETRY) else ''
    return child if kind == TF else '', [*_doubles(reader, 7), *6 * _NONE]


def _imu(reader: CdrReader) -> list[float]:
    numbers = _doubles(reader, 4 + _COVARIANCE + 3 + _COVARIANCE + 3)
    return [*3 * _NONE, *numbers[:4], *numbers[13:16], *numbers[-3:]]


def _decode(payload: bytes, kind: str) -> Iterator[tuple[str, list[float]]]:
    """Yield the child frame of each pose in a message, or '', with its stamp and numbers."""
    reader = CdrReader(payload)
    for _ in range(reader.uint32() if kind == TF else 1):
        stamp = _header(reader)
        name, numbers = ('', _imu(reader)) if kind == IMU else _pose(reader, kind)
        yield name, [stamp, *numbers]
