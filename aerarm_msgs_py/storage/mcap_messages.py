"""Where the messages are in a run of MCAP records."""

import struct
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.payloads import elements_at
from aerarm_msgs_py.storage.read_limits import ReadBudget

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
_DEFINITION_COST = 500  # bytes that reading one takes, and as long as reading so many of messages


class WalkedRecords(NamedTuple):
    """What a walk through records found.

    Attributes
    ----------
    starts
        (K,) where complete messages begin.
    definitions
        Opcode and content of the complete schema and channel records.
    unread
        Bytes at the end that are no complete record of a kind that may be there.
    """

    starts: NDArray[np.int64]
    definitions: list[tuple[int, bytes]]
    unread: int


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

    @property
    def messages(self) -> int:
        """How many messages the indexes list."""
        return sum(map(len, self._offsets))

    def add(self, content: bytes) -> None:
        """Take the content of a MessageIndex record."""
        if len(content) < _INDEX_HEADER.size:
            self.complete = False
            return
        channel, size = _INDEX_HEADER.unpack_from(content)
        if size % _INDEX_ENTRY.itemsize or _INDEX_HEADER.size + size != len(content):
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
        last = len(records) - MESSAGE_HEADER.itemsize
        if not (self.complete and self._offsets) or last < 0:
            return None
        offsets = np.sort(np.concatenate(self._offsets))
        if offsets[0] != 0 or offsets[-1] > last:
            return None
        starts = offsets.astype(np.int64)
        headers = elements_at(records, MESSAGE_HEADER, starts)
        follows = np.append(starts[1:], len(records))
        lengths = (follows - starts - RECORD.size).astype(np.uint64)
        whole = (headers['opcode'] == Opcode.MESSAGE) & (headers['length'] == lengths)
        return starts if whole.all() and _have_headers(headers) else None

    def agree_with(self, starts: NDArray[np.int64]) -> bool:
        """Tell whether they list the messages that begin there, or nothing at all."""
        if not self.complete:
            return False
        if not self._offsets:
            return True
        return np.array_equal(np.sort(np.concatenate(self._offsets)), starts.astype(np.uint64))


def walk(records: bytes, budget: ReadBudget) -> WalkedRecords:
    """Go through records one by one.

    Raises
    ------
    BagError
        If they define more than the limits allow.
    """
    starts: list[int] = []
    definitions: list[tuple[int, bytes]] = []
    position = 0
    size = len(records)
    last = size - RECORD.size
    unpack = RECORD.unpack_from
    message = int(Opcode.MESSAGE)  # comparing with the enumeration takes longer
    while position <= last:
        opcode, length = unpack(records, position)
        end = position + RECORD.size + length
        if end > size:
            break
        if opcode == message:
            if end < position + MESSAGE_HEADER.itemsize:
                break
            starts.append(position)
        elif opcode in _DEFINITIONS:
            budget.spend(_DEFINITION_COST)
            definitions.append((opcode, records[position + RECORD.size : end]))
        else:
            break
        position = end
    return WalkedRecords(np.array(starts, np.int64), definitions, size - position)


def _have_headers(headers: NDArray[np.void]) -> bool:
    return bool((headers['length'] >= MESSAGE_HEADER.itemsize - RECORD.size).all())
