"""Bags of 1 MB that are designed to exhaust memory and time: limits of 300 MB and 2 s."""

import struct
import zlib
from pathlib import Path

import lz4.frame
import pytest
from mutant_trial import PART, REFUSED, tried

SIZE = 1_000_000
PART_BYTES = 19_500_000


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(content)) + content


def text(value: str) -> bytes:
    return struct.pack('<I', len(value)) + value.encode()


def message(payload: bytes) -> bytes:
    return record(5, struct.pack('<HIQQ', 1, 0, 1_700_000_000, 0) + payload)


def topic(number: int, name: str) -> bytes:
    return record(4, struct.pack('<HH', number, 1) + text(name) + text('cdr') + text(''))


HEAD = (
    record(3, struct.pack('<H', 1) + text('sensor_msgs/msg/JointState') + text('') + text(''))
    + topic(1, '/joint_states')
)  # fmt: skip


def chunk(records: bytes) -> bytes:
    data = lz4.frame.compress(records)
    times_and_size = struct.pack('<QQQI', 0, 2**62, len(records), zlib.crc32(records))
    return record(6, times_and_size + text('lz4') + struct.pack('<Q', len(data)) + data)


def mcap(path: Path, unit: bytes) -> None:
    """Write a bag of 1 MB, mostly padding, with chunks of the largest size."""
    records = unit * (PART_BYTES // len(unit))
    chunks = chunk(HEAD + records) + 4 * chunk(records)
    start, end = b'\x89MCAP0\r\n' + record(1, text('ros2') + text('')), record(2, bytes(20))
    filling = record(12, bytes(SIZE - len(start + chunks + end) - 9 - 8))
    path.write_bytes(start + chunks + filling + end + b'\x89MCAP0\r\n')
    assert path.stat().st_size == SIZE


JOINT_STATE_WITHOUT_JOINTS = bytes.fromhex('00010000') + bytes(28)
UNITS = {
    'one message': message(JOINT_STATE_WITHOUT_JOINTS + bytes(PART_BYTES - 100)),
    'topics': record(4, b''),
}


@pytest.mark.parametrize('unit', UNITS.values(), ids=UNITS)
def test_a_bag_of_a_megabyte_takes_no_more_than_promised(tmp_path: Path, unit: bytes) -> None:
    path = tmp_path / 'bomb.mcap'
    mcap(path, unit)
    result = tried(path, [], checked=True, forged=True, finished=True)
    assert result.outcome in (PART, REFUSED, 'forged'), result
    assert result.time < 4.0  # 2 s of a processor that has nothing else to do
    # A program that reads bags has 31 to 80 MB of its own.
    assert result.grown < 220.0
