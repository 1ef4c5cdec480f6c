"""Messages of a chunk by its checked index, or by a scan."""

import struct
from pathlib import Path

import numpy as np
import pytest

from aerarm_msgs_py.storage.mcap_walk import ChunkIndexes, walk
from aerarm_msgs_py.storage.read_limits import ReadBudget

CHANNELS = (1, 2, 1, 3, 1)
BUDGET = ReadBudget(Path('bag'), 1000)


def chunk() -> tuple[bytes, list[int]]:
    records, starts = b'', []
    for k, channel in enumerate(CHANNELS):
        payload = bytes(k)
        starts.append(len(records))
        header = struct.pack('<BQHIQQ', 5, 22 + k, channel, k, 100 + k, 100 + k)
        records += header + payload
    return records, starts


def index(channel: int, starts: list[int]) -> bytes:
    own = [start for start, c in zip(starts, CHANNELS, strict=True) if c == channel]
    entries = b''.join(struct.pack('<QQ', 0, start) for start in own)
    return struct.pack('<HI', channel, len(entries)) + entries


def indexes(starts: list[int], channels: tuple[int, ...] = (3, 1, 2)) -> ChunkIndexes:
    found = ChunkIndexes()
    for channel in channels:
        found.add(index(channel, starts))
    return found


def test_index_and_walk_agree() -> None:
    records, starts = chunk()
    found = indexes(starts)
    assert found.channels == {1, 2, 3}
    offsets, headers = found.message_starts(records)
    assert offsets.tolist() == starts
    assert len(headers) == len(starts)
    walked, definitions, unread = walk(records, BUDGET)
    assert walked.tolist() == starts
    assert (definitions, unread) == ([], 0)
    assert found.messages == len(starts)
    assert found.agree_with(walked)


def test_an_incomplete_index_is_not_used() -> None:
    """A channel without index, other records in the chunk, places that are not messages."""
    records, starts = chunk()
    assert indexes(starts, (1, 2)).message_starts(records) is None
    assert indexes(starts).message_starts(records + b'\4' + bytes(8)) is None
    assert indexes([start + 1 for start in starts]).message_starts(records) is None
    assert indexes(starts).message_starts(records[:-1]) is None
    assert indexes(starts).message_starts(b'') is None
    assert ChunkIndexes().message_starts(records) is None


@pytest.mark.parametrize(
    'content',
    [
        b'',
        b'\1\0',
        struct.pack('<HI', 1, 16),
        b'\1\0\5\0\0\0' + bytes(5),
        struct.pack('<HIB', 1, 0, 0),
    ],
)
def test_a_broken_index_record_is_incomplete(content: bytes) -> None:
    records, starts = chunk()
    found = indexes(starts)
    found.add(content)
    assert not found.complete
    assert not found.agree_with(np.array(starts))
    assert found.message_starts(records) is None


def test_the_walk_yields_definitions_and_omits_truncated_messages() -> None:
    records, starts = chunk()
    schema = b'\3' + (4).to_bytes(8, 'little') + b'abcd'
    walked, definitions, unread = walk(schema + records[:-1], BUDGET)
    assert definitions == [(3, b'abcd')]
    assert walked.tolist() == [start + len(schema) for start in starts[:-1]]
    assert unread == len(records) - 1 - starts[-1]
    assert np.array_equal(walk(b'', BUDGET)[0], [])


@pytest.mark.parametrize(
    'strange',
    [b'\6' + bytes(8), b'\5' + (21).to_bytes(8, 'little') + bytes(21), b'\5' + b'\xff' * 8],
    ids=['no record of a chunk', 'a message without its fields', 'an endless message'],
)
def test_the_walk_ends_where_nothing_can_be(strange: bytes) -> None:
    records, starts = chunk()
    walked, _, unread = walk(records + strange + records, BUDGET)
    assert walked.tolist() == starts
    assert unread == len(strange) + len(records)


def test_an_index_with_offsets_beyond_the_file_is_not_used() -> None:
    records, starts = chunk()
    for place in (2**63 - 1, 2**64 - 1, len(records)):
        found = indexes(starts)
        found.add(struct.pack('<HIQQ', 1, 16, 0, place))
        assert found.message_starts(records) is None
        assert not found.agree_with(np.array(starts))
