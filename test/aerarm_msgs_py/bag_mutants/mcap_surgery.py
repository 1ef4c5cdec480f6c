"""Changes of MCAP files at format level, with a parser independent of the suite's.

Format: https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

import lz4.frame
import numpy as np
import zstandard

from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr

_MAGIC = 8
_HEAD = 9
_CHUNK, _INDEX, _SUMMARY, _FOOTER = 6, 7, (3, 4, 8, 10, 11, 13, 14, 15), 2
_ODD_NUMBERS = (0, 1, 2**7, 2**16 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**64 - 1)

Change = Callable[[bytes, np.random.Generator], bytes]


@dataclass(frozen=True)
class Part:
    """A record of a file: opcode, start and end."""

    opcode: int
    start: int
    end: int


def parts(content: bytes) -> list[Part]:
    """Return the records of a file, up to the first invalid one."""
    found = []
    start = _MAGIC
    while start + _HEAD <= len(content):
        opcode, length = struct.unpack_from('<BQ', content, start)
        end = start + _HEAD + length
        if end > len(content):
            break
        found.append(Part(opcode, start, end))
        start = end
        if opcode == _FOOTER:
            break
    return found


def _pick(found: list[Part], rng: np.random.Generator, *opcodes: int) -> Part | None:
    """Return a random part, optionally with one of some opcodes; None if there is none."""
    fitting = [part for part in found if not opcodes or part.opcode in opcodes]
    return fitting[rng.integers(len(fitting))] if fitting else None


def _groups(content: bytes) -> list[tuple[int, int]]:
    """Return the start of each chunk, and the end of its index records."""
    found = []
    for part in parts(content):
        if part.opcode == _CHUNK:
            found.append((part.start, part.end))
        elif part.opcode == _INDEX and found and found[-1][1] == part.start:
            found[-1] = (found[-1][0], part.end)
    return found


def _odd_number(old: int, rng: np.random.Generator) -> int:
    """Return another number: a close one, a fraction, or a limit."""
    kind = rng.integers(4)
    if kind == 0:
        return max(0, old + int(rng.integers(-64, 65)))
    if kind == 1:
        return int(old * rng.random())
    if kind == 2:
        return old ^ 1 << int(rng.integers(63))
    return _ODD_NUMBERS[rng.integers(len(_ODD_NUMBERS))]


def _with_number(content: bytes, place: int, size: int, rng: np.random.Generator) -> bytes:
    if place + size > len(content):
        return content
    old = int.from_bytes(content[place : place + size], 'little')
    new = _odd_number(old, rng) % 2 ** (8 * size)
    return content[:place] + new.to_bytes(size, 'little') + content[place + size :]


def length_of_a_record(content: bytes, rng: np.random.Generator) -> bytes:
    """Change a record's length, and nothing else."""
    part = _pick(parts(content), rng)
    return content if part is None else _with_number(content, part.start + 1, 8, rng)


def field_of_a_chunk(content: bytes, rng: np.random.Generator) -> bytes:
    """Change times, size, checksum or inner lengths of a chunk."""
    part = _pick(parts(content), rng, _CHUNK)
    if part is None:
        return content
    text = int.from_bytes(content[part.start + 37 : part.start + 41], 'little')
    fields = ((9, 8), (17, 8), (25, 8), (33, 4), (37, 4), (41 + text, 8))
    offset, size = fields[rng.integers(len(fields))]
    return _with_number(content, part.start + offset, size, rng)


def kind_of_a_record(content: bytes, rng: np.random.Generator) -> bytes:
    """Change an opcode."""
    part = _pick(parts(content), rng)
    if part is None:
        return content
    opcode = bytes([rng.integers(256) if rng.random() < 0.3 else rng.integers(16)])
    return content[: part.start] + opcode + content[part.start + 1 :]


def lying_index(content: bytes, rng: np.random.Generator) -> bytes:
    """Change channel, size, times or offsets of the index behind a chunk."""
    part = _pick(parts(content), rng, _INDEX)
    if part is None:
        return content
    entries = max(1, (part.end - part.start - 15) // 16)
    places = ((9, 2), (11, 4), *((15 + 16 * int(rng.integers(entries)) + k, 8) for k in (0, 8)))
    offset, size = places[rng.integers(len(places))]
    return _with_number(content, part.start + offset, size, rng)


def summary(content: bytes, rng: np.random.Generator) -> bytes:
    """Change any number of the summary or the footer."""
    part = _pick(parts(content), rng, *_SUMMARY, _FOOTER)
    if part is None:
        return content
    size = (1, 2, 4, 8)[rng.integers(4)]
    return _with_number(content, int(rng.integers(part.start, part.end)), size, rng)


def swapped_chunks(content: bytes, rng: np.random.Generator) -> bytes:
    """Exchange two chunks with their indexes."""
    groups = _groups(content)
    if len(groups) < 2:
        return content
    (a, b), (c, d) = sorted(groups[k] for k in rng.choice(len(groups), 2, replace=False))
    return content[:a] + content[c:d] + content[b:c] + content[a:b] + content[d:]


def repeated_chunk(content: bytes, rng: np.random.Generator) -> bytes:
    """Insert a copy of a chunk, with or without indexes, before or after another one."""
    groups = _groups(content)
    if not groups:
        return content
    start, end = groups[rng.integers(len(groups))]
    if rng.random() < 0.3:
        end = start + _HEAD + int.from_bytes(content[start + 1 : start + 9], 'little')
    place = groups[rng.integers(len(groups))][rng.integers(2)]
    return content[:place] + content[start:end] + content[place:]


def missing_chunk(content: bytes, rng: np.random.Generator) -> bytes:
    """Remove a chunk, with or without its indexes."""
    groups = _groups(content)
    if not groups:
        return content
    start, end = groups[rng.integers(len(groups))]
    if rng.random() < 0.5:
        end = start + _HEAD + int.from_bytes(content[start + 1 : start + 9], 'little')
    return content[:start] + content[end:]


def bomb(content: bytes, rng: np.random.Generator) -> bytes:
    """Insert a chunk, or replace one, with a very large decompressed size."""
    groups = _groups(content)
    if not groups:
        return content
    kind = rng.integers(5)
    records: bytes
    if kind == 0:  # only zeros
        records = bytes(int(rng.integers(1, 100)) * 1_000_000)
    elif kind == 1:  # the smallest messages
        records = _message(b'') * int(rng.integers(1000, 1_000_000))
    elif kind == 2:  # joint states without joints
        records = _message(bytes.fromhex('00010000') + bytes(28)) * int(rng.integers(500_000))
    elif kind == 3:  # every message names other joints
        payloads = [
            JointStateCdr([f'j{k}_{i}' for i in range(int(rng.integers(1, 9)))]).pack(k)
            for k in range(int(rng.integers(1, 1500)))
        ]
        records = b''.join(map(_message, payloads))
    else:  # an endless number of topic definitions
        topic = struct.pack('<HHI', 7, 1, 2) + b'/x' + bytes(8)
        records = (struct.pack('<BQ', 4, len(topic)) + topic) * int(rng.integers(100_000))
    made = _chunk(records, rng)
    start, end = groups[rng.integers(len(groups))]
    return content[:start] + made + content[end if rng.random() < 0.5 else start :]


def _message(payload: bytes) -> bytes:
    header = struct.pack('<BQHIQQ', 5, 22 + len(payload), 1, 0, 1_700_000_000, 0)
    return header + payload


def _chunk(records: bytes, rng: np.random.Generator) -> bytes:
    """Return a chunk record, which may declare a size that is too small."""
    compression = ('zstd', 'lz4')[rng.integers(2)]
    if compression == 'lz4':
        data = lz4.frame.compress(records)
    else:
        told = bool(rng.integers(2))
        data = zstandard.ZstdCompressor(write_content_size=told).compress(records)
    size = len(records) if rng.random() < 0.7 else int(rng.integers(2**20))
    fields = struct.pack('<QQQI', 0, 2**62, size, zlib.crc32(records))
    name = struct.pack('<I', len(compression)) + compression.encode()
    content = fields + name + struct.pack('<Q', len(data)) + data
    return struct.pack('<BQ', _CHUNK, len(content)) + content


CHANGES: tuple[Change, ...] = (
    length_of_a_record,
    field_of_a_chunk,
    kind_of_a_record,
    lying_index,
    summary,
    swapped_chunks,
    repeated_chunk,
    missing_chunk,
    bomb,
)
