"""Valid and damaged bags of rosbag2's other storage formats."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag_reader import lost_messages, read_joint_states
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning

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
    directory = write(tmp_path / 'bag', recording.messages(1100), storage, mode)
    series = read_joint_states(directory)
    np.testing.assert_array_equal(series.position, recording.numbers(1100)[:, 0])
    assert len(read_joint_states(directory, 'motor_states')) == 1100
    assert lost_messages(series.sequence) is None


def test_wrong_topics_and_files_raise_errors_with_the_reason(tmp_path: Path, recording) -> None:
    directory = write(tmp_path / 'bag', recording.messages(5), StoragePlugin.SQLITE3)
    with pytest.raises(BagError, match='no topic /imu: choose one of /joint_states'):
        read_joint_states(directory, '/imu')
    next(directory.glob('*.db3')).unlink()
    with pytest.raises(BagError, match=r'lacks the files bag.db3, which metadata.yaml lists'):
        read_joint_states(directory)


@pytest.fixture
def database(tmp_path: Path, recording) -> Path:
    directory = write(tmp_path / 'bag', recording.messages(500), StoragePlugin.SQLITE3)
    return next(directory.glob('*.db3'))


MANY_ROWS = (
    'INSERT INTO messages (topic_id, timestamp) WITH RECURSIVE r(k) AS '
    '(SELECT 1 UNION ALL SELECT k + 1 FROM r LIMIT 100000) SELECT 1, k FROM r'
)
COMPUTED = 'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data AS ({}))'
HOSTILE = {
    'an endless view': (
        'DROP TABLE messages',
        'CREATE VIEW messages AS WITH RECURSIVE r(id, topic_id, timestamp, data) AS (SELECT 1, 1, '
        "1, x'00' UNION ALL SELECT id + 1, 1, 1, data FROM r) SELECT * FROM r",
        'missing tables',
    ),
    'no messages': ('DROP TABLE messages', 'missing tables'),
    'large computed messages': (
        *('DROP TABLE messages', COMPUTED.format('zeroblob(60000000)'), MANY_ROWS),
        'more (memory|time) than the limit|100 times this size',
    ),
    'many computed messages': (
        *('DROP TABLE messages', COMPUTED.format('zeroblob(9000)'), MANY_ROWS),
        'more (memory|time) than the limit|100 times this size',
    ),
    'computed names': (
        'DROP TABLE topics',
        'CREATE TABLE topics (id INTEGER PRIMARY KEY, type, serialization_format, '
        'offered_qos_profiles, type_description_hash, name AS (hex(zeroblob(30000000))))',
        'INSERT INTO topics (type) VALUES (1)',
        'cannot be read|more memory than the limit',
    ),
    'very many topics': (
        "INSERT INTO topics SELECT NULL, '/t' || k, 'x', 'cdr', '', '' FROM (WITH RECURSIVE r(k) "
        'AS (SELECT 1 UNION ALL SELECT k + 1 FROM r LIMIT 5000) SELECT k FROM r)',
        'more than 4096 topics',
    ),
}


def change(database: Path, *statements: str) -> None:
    with sqlite3.connect(database) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()


@pytest.mark.parametrize('case', HOSTILE)
def test_hostile_tables_end_in_one_error(database: Path, case: str) -> None:
    *statements, said = HOSTILE[case]
    change(database, *statements)
    with pytest.raises(BagError, match=said):
        read_joint_states(database)


def test_values_of_other_types_are_ignored_with_a_warning(database: Path) -> None:
    change(
        database,
        "UPDATE messages SET timestamp = 'late' WHERE id = 7",
        'UPDATE messages SET data = 3.5 WHERE id = 9',
        'UPDATE messages SET topic_id = 77 WHERE id = 11',
    )
    with pytest.warns(BagWarning, match='ignores 3 messages with values of a wrong type'):
        assert len(read_joint_states(database)) == 497


def test_a_damaged_page_ends_in_one_error(database: Path) -> None:
    content = bytearray(database.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 4096] = bytes(4096)
    database.write_bytes(content)
    with pytest.raises(BagError, match='malformed; copy it again, or repair it'):
        read_joint_states(database)
