"""Valid and damaged bags of rosbag2's other storage formats."""

import sqlite3
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from aerarm_msgs_py.bags.bag_reader import read_joint_states, topics
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
    directory = write(tmp_path / 'bag', recording.messages(2500), storage, mode)
    series = read_joint_states(directory)
    np.testing.assert_array_equal(series.position, recording.numbers(2500)[:, 0])
    assert topics(directory)['/motor_states'].messages == 2500
    assert topics(directory)['/motor_states'].lost is None


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


@pytest.mark.parametrize(
    'table',
    [
        'CREATE VIEW messages AS WITH RECURSIVE r(id, topic_id, timestamp, data) AS (SELECT 1, 1, '
        "1, x'00' UNION ALL SELECT id + 1, 1, 1, data FROM r) SELECT * FROM r",
        'CREATE TABLE other (id)',
    ],
    ids=['an endless view', 'no messages'],
)
def test_only_tables_are_read(database: Path, table: str) -> None:
    with sqlite3.connect(database) as connection:
        connection.execute('DROP TABLE messages')
        connection.execute(table)
    connection.close()
    with pytest.raises(BagError, match='missing tables'):
        read_joint_states(database)


@pytest.mark.parametrize('computed', ['data AS (zeroblob(60000000))', 'data AS (zeroblob(9000))'])
def test_tables_that_compute_end_in_one_error(database: Path, computed: str) -> None:
    """A computed table generates any number of rows from a few bytes."""
    with sqlite3.connect(database) as connection:
        connection.execute('DROP TABLE messages')
        connection.execute(
            f'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, {computed})'
        )
        connection.execute(
            'INSERT INTO messages (topic_id, timestamp) WITH RECURSIVE r(k) AS '
            '(SELECT 1 UNION ALL SELECT k + 1 FROM r LIMIT 100000) SELECT 1, k FROM r'
        )
    connection.close()
    with pytest.raises(BagError, match='more (memory|time) than the limit|100 times this size'):
        read_joint_states(database)


def test_names_that_compute_end_in_one_error(database: Path) -> None:
    with sqlite3.connect(database) as connection:
        connection.execute('DROP TABLE topics')
        connection.execute(
            'CREATE TABLE topics (id INTEGER PRIMARY KEY, type, serialization_format, '
            'offered_qos_profiles, type_description_hash, name AS (hex(zeroblob(30000000))))'
        )
        connection.execute('INSERT INTO topics (type) VALUES (1)')
    connection.close()
    with pytest.raises(BagError, match='cannot be read|more memory than the limit'):
        read_joint_states(database)


def test_topics_have_a_number_and_a_length(database: Path) -> None:
    with sqlite3.connect(database) as connection:
        connection.executemany(
            "INSERT INTO topics VALUES (NULL, ?, 'x', 'cdr', '', '')",
            [(f'/t{k}',) for k in range(5000)],
        )
    connection.close()
    with pytest.raises(BagError, match='more than 4096 topics'):
        read_joint_states(database)


def test_values_of_other_types_are_ignored_with_a_warning(database: Path) -> None:
    with sqlite3.connect(database) as connection:
        connection.execute("UPDATE messages SET timestamp = 'late' WHERE id = 7")
        connection.execute('UPDATE messages SET data = 3.5 WHERE id = 9')
        connection.execute('UPDATE messages SET topic_id = 77 WHERE id = 11')
    connection.close()
    with pytest.warns(BagWarning, match='ignores 3 messages with values of a wrong type'):
        assert len(read_joint_states(database)) == 497


def test_a_damaged_page_ends_in_one_error(database: Path) -> None:
    content = bytearray(database.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 4096] = bytes(4096)
    database.write_bytes(content)
    with pytest.raises(BagError, match='malformed; copy it again, or repair it'):
        read_joint_states(database)
