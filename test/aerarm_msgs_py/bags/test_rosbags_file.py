"""Bags in storages that only the rosbags package reads."""

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag_error import BagError
from aerarm_msgs_py.bags.bag_reader import read_joint_states, topics

JOINT_STATE = 'sensor_msgs/msg/JointState'


def write(directory: Path, messages, storage: StoragePlugin, mode=CompressionMode.NONE) -> Path:
    writer = Writer(directory, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        connections = [
            writer.add_connection(name, JOINT_STATE, typestore=store)
            for name in ('/joint_states', '/motor_states')
        ]
        for message in messages:
            writer.write(connections[message.topic], message.log_time, message.payload)
    return directory


@pytest.mark.parametrize(
    ('storage', 'mode'),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_reads_other_storages(tmp_path: Path, recording, storage, mode) -> None:
    directory = write(tmp_path / 'bag', recording.messages(2500), storage, mode)
    series = read_joint_states(directory)
    np.testing.assert_array_equal(series.position, recording.numbers(2500)[:, 0])
    assert topics(directory)['/motor_states'].messages == 2500
    assert topics(directory)['/motor_states'].lost is None


def test_says_what_is_wrong(tmp_path: Path, recording) -> None:
    directory = write(tmp_path / 'bag', recording.messages(5), StoragePlugin.SQLITE3)
    with pytest.raises(BagError, match='no topic /imu; it has /joint_states'):
        read_joint_states(directory, '/imu')
    next(directory.glob('*.db3')).unlink()
    with pytest.raises(BagError, match=r'lacks bag.db3, which its metadata.yaml names'):
        read_joint_states(directory)
