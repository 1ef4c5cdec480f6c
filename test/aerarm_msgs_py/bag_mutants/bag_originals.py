"""Valid bags of every storage format, as bytes of their files, from which mutants are made."""

import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as PackageWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagMetadata
from aerarm_msgs_py.bags.mcap_writer import McapWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr

JOINT_STATE = 'sensor_msgs/msg/JointState'
NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
TOPICS = (RecordedTopic('/joint_states', JOINT_STATE), RecordedTopic('/motor_states', JOINT_STATE))
_START = 1_700_000_000_123_456_789
_CHUNK = 40  # messages

Files = dict[str, bytes]


@dataclass(frozen=True)
class OriginalBag:
    """A valid bag.

    Attributes
    ----------
    name
        Description of the bag.
    files
        Content of its files.
    checked
        Whether its messages have a checksum, so that every changed bit can be detected.
    finished
        Whether its recorder ended normally, and wrote message counts.
    """

    name: str
    files: Files
    checked: bool
    finished: bool


def messages(count: int, seed: int = 1) -> list[RecordedMessage]:
    """Return alternating joint states and motor states: random numbers, which compress badly."""
    cdr = JointStateCdr(NAMES)
    numbers = np.random.default_rng(seed).normal(size=(count, 3, len(NAMES)))
    made = []
    for k in range(count):
        stamp = _START + k * 1_000_000
        for topic, scale in ((0, 1.0), (1, 10.0)):
            payload = cdr.pack(stamp, *(scale * numbers[k]))
            made.append(RecordedMessage(topic, payload, stamp + 50_000 + topic, stamp, k + 1))
    return made


def originals(folder: Path, *names: str) -> list[OriginalBag]:
    """Return the named bags, or one of each kind; some must be written into `folder`."""
    sqlite, by_message = StoragePlugin.SQLITE3, CompressionMode.MESSAGE
    makers: dict[str, tuple[Callable[[], Files], bool, bool]] = {
        'zstd': (lambda: _own('zstd', 200), True, True),
        'lz4': (lambda: _own('lz4', 200), True, True),
        'uncompressed': (lambda: _own('none', 200), True, True),
        'killed recorder': (lambda: _own('zstd', 200, finished=False), True, False),
        '1 MB': (lambda: _own('zstd', 2400), True, True),
        'other writer': (lambda: package_bag(200), True, True),
        'without checksums': (lambda: package_bag(200, enable_crcs=False), False, True),
        'without chunks': (lambda: package_bag(200, use_chunking=False), False, True),
        'SQLite': (lambda: rosbags_bag(folder / 'a', sqlite, CompressionMode.NONE), False, True),
        'SQLite, compressed messages': (
            lambda: rosbags_bag(folder / 'b', sqlite, by_message),
            False,
            True,
        ),
        'compressed file': (
            lambda: rosbags_bag(folder / 'c', StoragePlugin.MCAP, CompressionMode.FILE),
            False,
            True,
        ),
        'ROS 1': (lambda: ros1_bag(folder / 'ros1.bag'), False, True),
    }
    return [
        OriginalBag(name, make(), checked, finished)
        for name, (make, checked, finished) in makers.items()
        if not names or name in names
    ]


def _own(compression: str, count: int, *, finished: bool = True) -> Files:
    """Return a bag of this suite; without an end if its recorder is killed."""
    stream = io.BytesIO()
    stream.write = _counting(stream.write)  # type: ignore[method-assign]
    writer = McapWriter(stream, TOPICS, compression)
    metadata = BagMetadata('bag_0.mcap', TOPICS)
    made = messages(count)
    known = ''
    for first in range(0, len(made), _CHUNK):
        if first <= len(made) // 2:
            known = metadata.to_yaml()  # the last metadata of a killed recorder
        part = made[first : first + _CHUNK]
        writer.add_chunk(part)
        for message in part:
            metadata.add(message.topic, message.log_time)
    if finished:
        writer.finish(metadata.serialized())
        known = metadata.to_yaml()
    return {'bag_0.mcap': stream.getvalue(), 'metadata.yaml': known.encode()}


def _counting(write: Callable[[bytes], int]) -> Callable[[bytes], int]:
    return lambda data: write(bytes(data))


def package_bag(count: int, **options: object) -> Files:
    """Return a file of the mcap package's writer, without metadata.yaml."""
    stream = io.BytesIO()
    writer = PackageWriter(
        stream,
        **{'compression': CompressionType.ZSTD, 'chunk_size': 10_000, **options},  # type: ignore[arg-type]
    )
    writer.start('ros2')
    schema = writer.register_schema(JOINT_STATE, 'ros2msg', b'')
    channels = [writer.register_channel(topic.name, 'cdr', schema) for topic in TOPICS]
    for m in messages(count):
        writer.add_message(channels[m.topic], m.log_time, m.payload, m.publish_time, m.sequence)
    writer.finish()
    return {'bag.mcap': stream.getvalue()}


def rosbags_bag(folder: Path, storage: StoragePlugin, mode: CompressionMode) -> Files:
    """Return a bag of rosbags' writer, which is written into `folder`."""
    writer = RosbagsWriter(folder, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        channels = [writer.add_connection(t.name, t.type, typestore=store) for t in TOPICS]
        for message in messages(200):
            writer.write(channels[message.topic], message.log_time, message.payload)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def ros1_bag(
    path: Path, compression: Ros1Writer.CompressionFormat | None = Ros1Writer.CompressionFormat.BZ2
) -> Files:
    """Return a bag of ROS 1, which is written to `path`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Ros1Writer(path)
    writer.chunk_threshold = 10_000
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        noetic = get_typestore(Stores.ROS1_NOETIC)
        channels = [writer.add_connection(t.name, t.type, typestore=noetic) for t in TOPICS]
        for message in messages(200):
            payload = store.cdr_to_ros1(message.payload, JOINT_STATE)
            writer.write(channels[message.topic], message.log_time, payload)
    return {path.name: path.read_bytes()}
