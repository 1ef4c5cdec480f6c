"""Limits, decompression, and bags of every storage format, valid and damaged."""

import bz2
import sqlite3
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from bag_originals import Files, originals, package_bag, ros1_bag, rosbags_bag
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from aerarm_msgs_py.bags.bag_reader import read_contents, read_joint_states
from aerarm_msgs_py.sequence_gaps import lost_messages
from aerarm_msgs_py.storage.compressed_file import decompress
from aerarm_msgs_py.storage.mcap_file import McapFile
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning, ReadBudget, ReadLimits

COUNT = 200
DATA = np.random.default_rng(3).integers(0, 50, 400_000, np.uint8).tobytes()
COMPRESS = {
    '': bytes,
    'lz4': lz4.frame.compress,
    'zstd': zstandard.ZstdCompressor(write_content_size=False).compress,
}
FOREIGN = ('SQLite', 'SQLite, compressed messages', 'compressed file', 'ROS 1')
NAMES = ('zstd', 'lz4', 'uncompressed', 'killed recorder', '1 MB', 'other writer',
         'without checksums', 'without chunks', *FOREIGN)  # fmt: skip
ROS1 = {'ROS 1, plain': None, 'ROS 1, lz4': Ros1Writer.CompressionFormat.LZ4}
ROSBAGS = {
    'MCAP of rosbags': CompressionMode.NONE,
    'MCAP of rosbags, compressed messages': CompressionMode.MESSAGE,
    'MCAP of rosbags, compressed chunks': CompressionMode.STORAGE,
}


def test_the_memory_of_a_bag_is_limited_to_a_multiple_of_its_size() -> None:
    for wrong in ({'ratio': 0.0}, {'ratio': float('nan')}, {'part_bytes': 0}):
        with pytest.raises(BagError, match='set it to 1 or more'):
            ReadLimits(**wrong)
    budget = ReadBudget(Path('bag'), 10_000_000, ReadLimits(ratio=3.0))
    budget.spend(20_000_000)
    budget.spend(10_000_000)
    with pytest.raises(BagError, match='10000000 bytes needs more than 3 times this size'):
        budget.spend(1)
    ReadBudget(Path('bag'), 1, ReadLimits(ratio=1.0)).spend(4_000_000)


@pytest.mark.parametrize('compression', COMPRESS)
def test_data_are_decompressed_up_to_their_end_their_damage_or_a_limit(compression: str) -> None:
    compressed = COMPRESS[compression](DATA)
    assert decompress(compressed, compression, len(DATA) + 1) == DATA
    assert decompress(compressed, compression, 1000) == DATA[:1000]
    assert decompress(compressed, compression, 0) == b''
    half = decompress(compressed[: len(compressed) // 2], compression, len(DATA))
    assert len(half) > len(DATA) // 4
    assert DATA.startswith(half)
    if compression:
        assert decompress(b'no frame at all', compression, 1000) == b''
        bomb = COMPRESS[compression](bytes(200_000_000))
        tracemalloc.start()
        assert decompress(bomb, compression, 1000) == bytes(1000)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
        tracemalloc.stop()


def test_an_unknown_compression_is_named() -> None:
    with pytest.raises(ValueError, match="unknown compression 'brotli'"):
        decompress(b'', 'brotli', 0)


def files(folder: Path, name: str) -> Files:
    if name in ROS1:
        return ros1_bag(folder / 'a.bag', ROS1[name])
    if name in ROSBAGS:
        return rosbags_bag(folder / 'bag', StoragePlugin.MCAP, ROSBAGS[name])
    (bag,) = originals(folder, name)
    return bag.files


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a bag of bag_originals.py, and returns one of its files."""

    def write(name: str, file: str = '') -> Path:
        (tmp_path / 'made').mkdir()
        folder = tmp_path / 'bag'
        folder.mkdir()
        for path, content in files(tmp_path / 'made', name).items():
            (folder / path).write_bytes(content)
        return next(folder.glob(file)) if file else folder

    return write


@pytest.mark.parametrize('name', [*NAMES, *ROS1, *ROSBAGS])
def test_bags_of_every_format_are_read(write, name: str) -> None:
    bag = write(name, '*.bag' if name.startswith('ROS 1') else '')
    contents = read_contents(bag, '/joint_states', ['/motor_states'])
    series, motors = (contents.joint_states[f'/{kind}_states'] for kind in ('joint', 'motor'))
    numbers = np.random.default_rng(1).normal(size=(len(series), 3, 4))  # of bag_originals.py
    assert len(series) == len(motors) == (2400 if name == '1 MB' else COUNT)
    values = np.stack([series.position, series.velocity, series.effort], axis=1)
    np.testing.assert_array_equal(values, numbers)
    np.testing.assert_array_equal(motors.effort, 10.0 * series.effort)
    assert not contents.damaged
    is_numbered = name not in (*FOREIGN, *ROS1, *ROSBAGS)
    assert lost_messages(series.sequence.tolist()) == (0 if is_numbered else None)


def test_a_large_file_without_chunks_is_read_in_bounded_blocks(tmp_path: Path) -> None:
    path = tmp_path / 'a.mcap'
    path.write_bytes(package_bag(4000, use_chunking=False)['bag.mcap'])
    blocks = list(McapFile(path, ReadBudget(path, path.stat().st_size)).blocks(['/joint_states']))
    assert sum(len(block.payloads) for block in blocks) == 4000
    assert max(len(block.payloads) for block in blocks) < 3000


def test_a_missing_end_is_warned_about(write) -> None:
    path = write('without chunks', '*.mcap')
    content = path.read_bytes()
    end = content.index(b'\x0f\x04\0\0\0\0\0\0\0')  # the record that ends the messages
    for changed, count in (
        *((content[: end - cut], COUNT - 1) for cut in (1, 5, 9, 30, 100)),
        (content[:end] + bytes(500), COUNT),
    ):
        path.write_bytes(changed)
        with pytest.warns(BagWarning, match='is cut off'):
            contents = read_contents(path, 'motor_states')
        assert len(contents.joint_states['/motor_states']) == count
        assert (contents.expected, contents.damaged) == (None, True)


def test_a_file_that_is_no_frame_or_becomes_too_large_is_refused(write) -> None:
    file = write('compressed file', '*.zstd')
    bag = file.parent
    file.write_bytes(zstandard.compress(b'\x89MCAP0\r\n' + bytes(500_000_000)))
    with pytest.raises(BagError, match='more than 100 times this size'):
        read_joint_states(bag)
    file.write_bytes(b'nothing of the kind')
    with pytest.raises(BagError, match='cannot be decompressed'):
        read_joint_states(bag)


def test_messages_that_cannot_be_decompressed_are_counted(write) -> None:
    file = write('SQLite, compressed messages', '*.db3')
    bag = file.parent
    content = file.read_bytes()
    place = content.index(b'\x28\xb5\x2f\xfd', len(content) // 2)
    file.write_bytes(content[:place] + b'\0' + content[place + 1 :])
    with pytest.warns(BagWarning) as caught:
        states, motors = (
            read_joint_states(bag, topic) for topic in ('joint_states', 'motor_states')
        )
    assert sorted((len(states), len(motors))) == [COUNT - 1, COUNT]
    texts = [str(warning.message) for warning in caught]
    assert any('ignores 1 messages of' in t and 'compressed data are damaged' in t for t in texts)
    assert any(f'1 of the {COUNT} messages of' in t and 'are missing' in t for t in texts)


def test_wrong_topics_and_files_raise_errors_with_the_reason(write, tmp_path) -> None:
    database = write('SQLite', '*.db3')
    with pytest.raises(BagError, match='no topic /imu: choose one of /joint_states'):
        read_joint_states(database.parent, '/imu')
    database.unlink()
    with pytest.raises(
        BagError, match='is not a bag .*: check the path, or copy the whole directory again'
    ):
        read_joint_states(database.parent)
    (tmp_path / 'b.bag').write_bytes(b'#ROSBAG V1.2\n')
    with pytest.raises(BagError, match=r'not a ROS 1 bag \(format version 2.0\)'):
        read_joint_states(tmp_path / 'b.bag')


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
def test_hostile_tables_end_in_one_error(write, case: str) -> None:
    *statements, said = HOSTILE[case]
    database = write('SQLite', '*.db3')
    change(database, *statements)
    with pytest.raises(BagError, match=said):
        read_joint_states(database)


def test_values_of_other_types_are_ignored_with_a_warning(write) -> None:
    database = write('SQLite', '*.db3')
    change(
        database,
        "UPDATE messages SET timestamp = 'late' WHERE id = 7",
        'UPDATE messages SET data = 3.5 WHERE id = 9',
        'UPDATE messages SET topic_id = 77 WHERE id = 11',
    )
    with pytest.warns(BagWarning, match='ignores 3 messages with values of a wrong type'):
        assert len(read_joint_states(database)) == COUNT - 3


def test_a_damaged_page_ends_in_one_error(write) -> None:
    database = write('SQLite', '*.db3')
    content = bytearray(database.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 4096] = bytes(4096)
    database.write_bytes(content)
    with pytest.raises(BagError, match='malformed; copy it again, or repair it'):
        read_joint_states(database)


def test_a_damaged_ros1_bag_is_read_up_to_the_damage_if_it_has_an_index(write) -> None:
    bag = write('ROS 1', '*.bag')
    content = bag.read_bytes()
    bag.write_bytes(content[: len(content) // 2])
    with pytest.raises(BagError, match='cannot be read: Bag index looks damaged.*rosbag reindex'):
        read_joint_states(bag)
    first = content.index(b'BZh9')
    second = content.index(b'BZh9', first + 4)
    damaged = bytearray(content)
    damaged[second + 200] ^= 0xFF
    bag.write_bytes(damaged)
    with pytest.warns(BagWarning, match=r'is damaged .*: only the \d+ messages before') as told:
        series = read_joint_states(bag)
    assert any('messages of /joint_states are missing' in str(w.message) for w in told)
    assert 0 < len(series) < COUNT
    # A few hundred bytes decompress to four hundred megabytes.
    bomb = 40 * bz2.compress(bytes(10_000_000))
    assert len(bomb) < second - first
    # Its length stays: what follows the stream's end is ignored.
    bag.write_bytes(content[:first] + bomb + content[first + len(bomb) :])
    with pytest.raises(BagError, match='takes more memory than the limit for its size'):
        read_joint_states(bag)
