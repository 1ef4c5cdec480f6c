"""Records of a chunk."""

import struct
from pathlib import Path

import numpy as np
import pytest

from aerarm_msgs_py.storage.mcap_walk import indexed_messages, walk
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


def test_an_index_record_has_a_number_of_messages_or_is_damaged() -> None:
    assert indexed_messages(struct.pack('<HI', 1, 32) + bytes(32)) == 2
    for content in (
        b'',
        b'\1\0',
        struct.pack('<HI', 1, 16),
        b'\1\0\5\0\0\0' + bytes(5),
        struct.pack('<HIB', 1, 0, 0),
    ):
        assert indexed_messages(content) is None


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
