"""Damage of MCAP files that leaves the format intact, or nearly."""

import struct
import warnings
from pathlib import Path

import mcap_surgery
import pytest
import zstandard
from bag_originals import TOPICS, messages
from mcap.writer import Writer

from aerarm_msgs_py.bags.bag import Bag, RecordedMessage
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.bags.mcap_writer import McapWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.storage.read_limits import BagError, BagWarning, ReadLimits

COUNT, CHUNK = 200, 40


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file of ten chunks of 20 joint states each."""
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream, TOPICS, 'zstd')
        made = messages(COUNT)
        for first in range(0, len(made), CHUNK):
            writer.add_chunk(made[first : first + CHUNK])
        writer.finish('')
    return path


def chunks(content: bytes) -> list[mcap_surgery.Part]:
    return [part for part in mcap_surgery.parts(content) if part.opcode == 6]


OTHER_KINDS = [*range(6), *range(7, 16), 100, 134, 255]
LENGTHS = [0, 1, 500, 10**6, 2**62, 2**64 - 1]
WITHOUT_ONE = [*range(1, 61), *range(81, 201)]
ALL = list(range(1, COUNT + 1))


@pytest.mark.parametrize(
    ('opcode', 'length'),
    [*((6, length) for length in LENGTHS), *((opcode, None) for opcode in OTHER_KINDS)],
)
def test_a_chunk_of_another_kind_or_length_is_missing_alone(file, opcode, length) -> None:
    content = bytearray(file.read_bytes())
    start = chunks(content)[3].start
    content[start] = opcode
    if length is not None:
        struct.pack_into('<Q', content, start + 1, length)
    file.write_bytes(content)
    with pytest.warns(BagWarning, match=r'20 of the 200 messages of /joint_states are missing'):
        assert read_joint_states(file).sequence.tolist() == WITHOUT_ONE
    file.write_bytes(content[:-8])  # without an end there is no summary that knows of chunks
    with pytest.warns(BagWarning, match=r'is cut off|damaged'):
        assert read_joint_states(file).sequence.tolist()[:60] == WITHOUT_ONE[:60]


def repeated(content: bytes) -> bytes:
    (a, b), (c, _) = ((part.start, part.end) for part in chunks(content)[2:4])
    return content[:c] + content[a:b] + content[c:]


def swapped(content: bytes) -> bytes:
    a, b, c = (part.start for part in chunks(content)[2:5])
    return content[:a] + content[b:c] + content[a:b] + content[c:]


def without_chunk_and_summary(content: bytes) -> bytes:
    """As in a file of a killed recorder, which has no summary with counts."""
    chunk = chunks(content)[3]
    content = content[: chunk.start] + content[chunk.end :]
    return content[: chunks(content)[-1].end]


def renamed(content: bytes) -> bytes:
    return content.replace(b'/motor_states', b'/joint_states', 1)


@pytest.mark.parametrize(
    ('change', 'warning', 'expected'),
    [
        (repeated, 'is stored twice: the reader returns its messages once', ALL),
        (swapped, '', ALL),
        (without_chunk_and_summary, 'lists 80 messages, but the chunk contains 40', WITHOUT_ONE),
        (renamed, 'channel 2 has the two topics /motor_states and /joint_states', ALL),
    ],
)
def test_chunks_that_are_not_as_recorded(file: Path, change, warning: str, expected) -> None:
    file.write_bytes(change(file.read_bytes()))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter('always')
        assert read_joint_states(file).sequence.tolist() == expected
    texts = [str(found.message) for found in caught]
    assert any(warning in text for text in texts) if warning else not texts
    assert change is renamed or len(set(texts)) == len(texts)


def bomb(size: int) -> bytes:
    """Return a chunk of zeros."""
    data = zstandard.compress(bytes(size))
    record = struct.pack('<QQQII', 0, 0, size, 0, 4) + b'zstd' + struct.pack('<Q', len(data)) + data
    return struct.pack('<BQ', 6, len(record)) + record


def test_a_bag_larger_than_its_limits_is_refused_or_read_in_part(file: Path) -> None:
    with (
        pytest.warns(BagWarning, match='limits part_bytes and ratio'),
        pytest.raises(BagError, match='all messages of topic .* are unreadable'),
    ):
        read_joint_states(file, limits=ReadLimits(part_bytes=1000))
    content = file.read_bytes()
    start = chunks(content)[3].start
    file.write_bytes(content[:start] + bomb(40_000_000) + content[start:])
    with pytest.warns(BagWarning, match='40000000 bytes, above the limit of 4194304'):
        assert len(read_joint_states(file)) == COUNT
    file.write_bytes(content[:start] + 10 * bomb(4_000_000) + content[start:])
    with pytest.raises(BagError, match='more than 100 times this size'):
        read_joint_states(file)
    with pytest.warns(BagWarning, match='bytes after 0 messages are not messages'):
        found = read_joint_states(file, limits=ReadLimits(ratio=5000.0))
    assert len(found) == COUNT


def test_very_many_topics_are_refused(tmp_path: Path) -> None:
    path = tmp_path / 'bag.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start('ros2')
        for k in range(5000):
            writer.register_channel(f'/{k}', 'cdr', 0)
        writer.finish()
    with pytest.raises(BagError, match='more than 4096 topics'):
        list(Bag(path).blocks())


def test_damage_at_very_many_places_is_summed_up(file: Path) -> None:
    content = bytearray(file.read_bytes())
    for part in chunks(content):
        content[part.end - 20] ^= 1
    file.write_bytes(content)
    unreadable = 'all messages of topic .* are unreadable'
    with pytest.warns(BagWarning) as caught, pytest.raises(BagError, match=unreadable):
        read_joint_states(file)
    texts = [str(warning.message) for warning in caught]
    lost = sum(part.end - part.start - 9 for part in chunks(content))
    assert sum('is damaged and ignored' in text for text in texts) == 5
    assert any(f'damaged at 10 places; the reader ignores {lost} bytes' in t for t in texts)


def test_no_count_of_joints_takes_the_memory(tmp_path: Path) -> None:
    path = tmp_path / 'bag.mcap'
    made = [
        RecordedMessage(0, JointStateCdr([f'j{k}_{i}' for i in range(100)]).pack(k), k, k, k)
        for k in range(3)
    ]
    with path.open('wb') as stream:
        writer = McapWriter(stream, TOPICS)
        writer.add_chunk(made)
        writer.finish('')
    with pytest.raises(BagError, match='more than 256 joints'):
        read_joint_states(path)
