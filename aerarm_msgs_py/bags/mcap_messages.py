"""Where the messages are in a run of MCAP records."""

import struct
from dataclasses import dataclass, field

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.payloads import elements_at

RECORD = struct.Struct('<BQ')
"""Opcode and length in front of every record."""
MESSAGE_HEADER = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)
"""Beginning of a message record, the payload follows."""

_INDEX_HEADER = struct.Struct('<HI')  # channel, bytes of the entries
_INDEX_ENTRY = np.dtype([('log_time', '<u8'), ('offset', '<u8')])
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)


@dataclass
class ChunkIndexes:
    """The index records behind one chunk.

    Attributes
    ----------
    channels
        With messages in the chunk.
    complete
        Whether every index could be read.
    """

    channels: set[int] = field(default_factory=set)
    complete: bool = True
    _offsets: list[NDArray[np.uint64]] = field(default_factory=list)

    def add(self, content: bytes) -> None:
        """Take the content of a MessageIndex record."""
        if len(content) < _INDEX_HEADER.size:
            self.complete = False
            return
        channel, size = _INDEX_HEADER.unpack_from(content)
        if size % _INDEX_ENTRY.itemsize or _INDEX_HEADER.size + size > len(content):
            self.complete = False
            return
        entries = np.frombuffer(
            content, _INDEX_ENTRY, size // _INDEX_ENTRY.itemsize, _INDEX_HEADER.size
        )
        if len(entries):
            self.channels.add(channel)
            self._offsets.append(entries['offset'])

    def message_starts(self, records: bytes) -> NDArray[np.int64] | None:
        """Return where the messages of the chunk begin, in order.

        Returns
        -------
        (K,) offsets, or None if the index doesn't account for every byte of the chunk: it is
        damaged, or the chunk holds other records too.
        """
        if not (self.complete and self._offsets):
            return None
        starts = np.sort(np.concatenate(self._offsets)).astype(np.int64)
        if starts[0] != 0 or starts[-1] + MESSAGE_HEADER.itemsize > len(records):
            return None
        headers = elements_at(records, MESSAGE_HEADER, starts)
        ends = starts + RECORD.size + headers['length'].astype(np.int64)
        follows = np.append(starts[1:], len(records))
        whole = (headers['opcode'] == Opcode.MESSAGE) & (ends == follows)
        return starts if whole.all() and _have_headers(headers) else None


def walk(records: bytes) -> tuple[NDArray[np.int64], list[tuple[int, bytes]]]:
    """Go through records one by one.

    Returns
    -------
    starts
        (K,) where complete messages begin.
    definitions
        Opcode and content of the complete schema and channel records.
    """
    starts: list[int] = []
    definitions: list[tuple[int, bytes]] = []
    position = 0
    last = len(records) - RECORD.size
    unpack = RECORD.unpack_from
    message = int(Opcode.MESSAGE)  # comparing with the enumeration takes longer
    while position <= last:
        opcode, length = unpack(records, position)
        end = position + RECORD.size + length
        if opcode == message:
            if position + MESSAGE_HEADER.itemsize <= end <= len(records):
                starts.append(position)
        elif opcode in _DEFINITIONS and end <= len(records):
            definitions.append((opcode, records[position + RECORD.size : end]))
        position = end
    return np.array(starts, np.int64), definitions


def _have_headers(headers: NDArray[np.void]) -> bool:
    return bool((headers['length'] >= MESSAGE_HEADER.itemsize - RECORD.size).all())
