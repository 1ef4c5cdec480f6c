"""Valid and damaged bags of ROS 1, written by another program."""

import bz2
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag_reader import read_contents, read_joint_states
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning

JOINT_STATE = 'sensor_msgs/msg/JointState'
COUNT = 300
NAMES = ['elbow', 'wrist_roll', 'x']
START = 1_500_000_000_987_654_321
STORE = get_typestore(Stores.ROS1_NOETIC)
FORMATS = {'none': None, 'bz2': Writer.CompressionFormat.BZ2, 'lz4': Writer.CompressionFormat.LZ4}


def numbers() -> np.ndarray:
    return np.random.default_rng(4).normal(size=(COUNT, 3, len(NAMES)))


def write(path: Path, compression: str = 'none') -> Path:
    """Write joint states and modes, with chunks of a few dozen messages."""
    kind, header = (STORE.types[x] for x in (JOINT_STATE, 'std_msgs/msg/Header'))
    text, time = STORE.types['std_msgs/msg/String'], STORE.types['builtin_interfaces/msg/Time']
    writer = Writer(path)
    writer.chunk_threshold = 10_000
    if FORMATS[compression] is not None:
        writer.set_compression(FORMATS[compression])
    with writer:
        states = writer.add_connection('/joint_states', kind.__msgtype__, typestore=STORE)
        modes = writer.add_connection('/arm_mode', text.__msgtype__, typestore=STORE)
        for k, (q, dq, tau) in enumerate(numbers()):
            stamp = START + k * 8_000_000
            stamped = header(seq=k, stamp=time(*divmod(stamp, 10**9)), frame_id='base')
            message = kind(stamped, NAMES, q, dq, tau)
            payload = STORE.serialize_ros1(message, kind.__msgtype__)
            writer.write(states, stamp + 1000, payload)
            if k % 100 == 0:
                said = STORE.serialize_ros1(text(f'mode {k}'), text.__msgtype__)
                writer.write(modes, stamp + 2000, said)
    return path


@pytest.mark.parametrize('compression', FORMATS)
def test_recorded_messages_are_read_back(tmp_path: Path, compression: str) -> None:
    bag = write(tmp_path / 'a.bag', compression)
    contents = read_contents(bag, '/joint_states', ['/arm_mode'])
    series = contents.joint_states['/joint_states']
    assert series.names == tuple(NAMES)
    assert contents.expected == COUNT
    assert not contents.damaged
    values = np.stack([series.position, series.velocity, series.effort], axis=1)
    np.testing.assert_array_equal(values, numbers())
    np.testing.assert_allclose(series.stamp, START / 1e9 + 8e-3 * np.arange(COUNT), atol=5e-7)
    assert [said for _, said in contents.texts['/arm_mode']] == ['mode 0', 'mode 100', 'mode 200']


def test_a_bag_without_its_end_must_be_indexed_first(tmp_path: Path) -> None:
    bag = write(tmp_path / 'a.bag')
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) // 2])
    with pytest.raises(BagError, match='cannot be read: Bag index looks damaged.*rosbag reindex'):
        read_joint_states(bag)


def test_messages_after_the_damage_are_lost(tmp_path: Path) -> None:
    bag = write(tmp_path / 'a.bag', 'bz2')
    data = bytearray(bag.read_bytes())
    second = data.index(b'BZh9', data.index(b'BZh9') + 4)
    data[second + 200] ^= 0xFF
    bag.write_bytes(data)
    with pytest.warns(BagWarning, match=r'is damaged .*: only the \d+ messages before') as told:
        contents = read_contents(bag, '/joint_states')
    assert any('messages of /joint_states are missing' in str(w.message) for w in told)
    series = contents.joint_states['/joint_states']
    assert 0 < len(series) < COUNT
    np.testing.assert_array_equal(series.position, numbers()[: len(series), 0])


def test_another_format_raises_an_error(tmp_path: Path) -> None:
    (tmp_path / 'b.bag').write_bytes(b'#ROSBAG V1.2\n')
    with pytest.raises(BagError, match=r'not a ROS 1 bag \(format version 2.0\)'):
        read_joint_states(tmp_path / 'b.bag')
    with pytest.raises(BagError, match='no topic /imu: choose one of /arm_mode'):
        read_joint_states(write(tmp_path / 'c.bag'), '/imu')


def test_a_bomb_ends_in_one_error(tmp_path: Path) -> None:
    """A few hundred bytes decompress to four hundred megabytes."""
    bag = write(tmp_path / 'a.bag', 'bz2')
    data = bag.read_bytes()
    first = data.index(b'BZh9')
    bomb = 40 * bz2.compress(bytes(10_000_000))
    second = data.index(b'BZh9', first + 4)
    assert len(bomb) < second - first
    # Its length stays: what follows the stream's end is ignored.
    bag.write_bytes(data[:first] + bomb + data[first + len(bomb) :])
    with pytest.raises(BagError, match='takes more memory than the limit for its size'):
        read_joint_states(bag)
