"""Iteration over the records of an MCAP file; the iteration continues after damage if possible."""

import struct
import zlib
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.storage.mcap_records import RecordFields
from aerarm_msgs_py.storage.read_limits import DamageReport, ReadBudget

RECORD = struct.Struct('<BQ')
"""Format of the first bytes of every record: opcode and length."""
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
"""Format of the first fields of a message record, which precede the payload."""

_INDEX_ENTRY_SIZE = 16
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
_DEFINITION_COST = 500  # bytes counted per definition, for its memory and reading time


def indexed_messages(content: bytes) -> int | None:
    """Return how many messages an index record lists; None if the record is damaged."""
    fields = RecordFields(content)
    try:
        fields.take(2)  # channel
        count, rest = divmod(len(fields.take(fields.number(4))), _INDEX_ENTRY_SIZE)
    except ValueError:
        return None
    return None if rest or fields.left else count


def walk(
    records: bytes, budget: ReadBudget
) -> tuple[NDArray[np.int64], list[tuple[int, bytes]], int]:
    """Scan the consecutive schema, channel and message records of a chunk.

    Returns
    -------
    starts : (K,) offsets of the complete message records
    definitions : opcode and content of the complete schema and channel records
    unread : number of bytes at the end that are not a complete record of a valid kind

    Raises
    ------
    BagError
        If the schema and channel records exceed the remaining limits.
    """
    starts: list[int] = []
    definitions: list[tuple[int, bytes]] = []
    position = 0
    size = len(records)
    last = size - RECORD.size
    unpack = RECORD.unpack_from
    message = int(Opcode.MESSAGE)  # comparing with the enumeration is slower
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
    return np.array(starts, np.int64), definitions, size - position


MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of an MCAP file."""
FOOTER_SIZE = 20
"""Size of the content of the footer record [bytes]."""


@dataclass
class McapSummary:
    """Summary at the end of an MCAP file; empty if it is missing or damaged.

    Attributes
    ----------
    channels
        Topic of each channel.
    counts
        Number of messages of each channel; None if unknown.
    chunks
        Offsets of the chunks, in order.
    """

    channels: dict[int, str] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    chunks: list[int] = field(default_factory=list)


def read_summary(stream: BinaryIO, size: int, most: int) -> McapSummary:
    """Read the summary at the end of an MCAP file.

    Parameters
    ----------
    stream
        Stream of the file, at any position.
    size
        Size of the file [bytes].
    most
        Largest size of a summary [bytes]; a larger summary is not read.
    """
    end = size - RECORD.size - FOOTER_SIZE - len(MAGIC)
    if end < len(MAGIC):
        return McapSummary()
    stream.seek(end)
    footer = stream.read(RECORD.size + FOOTER_SIZE)
    fields = RecordFields(footer[RECORD.size :])
    start, _, crc = fields.number(8), fields.number(8), fields.number(4)
    is_footer = RECORD.unpack_from(footer) == (Opcode.FOOTER, FOOTER_SIZE)
    if not is_footer or stream.read() != MAGIC or not len(MAGIC) < start < end <= start + most:
        return McapSummary()
    stream.seek(start)
    content = stream.read(end - start)
    # The checksum covers the footer up to the checksum.
    if crc and zlib.crc32(content + footer[:-4]) != crc:
        return McapSummary()
    try:
        return _summary(content)
    except ValueError:
        return McapSummary()


def _summary(content: bytes) -> McapSummary:
    summary = McapSummary()
    records = RecordFields(content)
    while records.left:
        opcode, length = records.number(1), records.number(8)
        fields = RecordFields(records.take(length))
        if opcode == Opcode.CHANNEL:
            number, _ = fields.number(2), fields.number(2)
            summary.channels[number] = fields.text()
        elif opcode == Opcode.CHUNK_INDEX:
            fields.take(16)  # first and last time
            summary.chunks.append(fields.number(8))
        elif opcode == Opcode.STATISTICS:
            summary.counts = read_counts(fields)
    summary.chunks.sort()
    return summary


def read_counts(fields: RecordFields) -> dict[int, int]:
    """Return the number of messages of each channel from a statistics record.

    Raises
    ------
    ValueError
        If the record is damaged.
    """
    fields.take(42)  # other counts, first and last time
    entries = RecordFields(fields.take(fields.number(4)))
    counts = {}
    while entries.left:
        channel = entries.number(2)
        counts[channel] = entries.number(8)
    return counts


_PRIVATE = 128  # first opcode for private records
_KINDS = frozenset(map(int, Opcode))
_SIZES = {Opcode.FOOTER: FOOTER_SIZE, Opcode.DATA_END: 4}
_SMALLEST = {Opcode.CHUNK: 40, Opcode.MESSAGE: MESSAGE_HEADER.itemsize - RECORD.size}


class McapRecord(NamedTuple):
    """Kind and place of one record of an MCAP file.

    Attributes
    ----------
    start
        Offset of the record [bytes].
    length
        Size of the record's content [bytes].
    whole
        False for a truncated last record.
    """

    opcode: int
    start: int
    length: int
    whole: bool = True


class McapWalk:
    """Iterable over the records of an MCAP file, in order.

    At an invalid record, the iteration continues at the next chunk that the summary of the file
    lists. If the file has no summary, the iteration ends there. McapWalk reports invalid records.

    Parameters
    ----------
    stream
        Stream of the file.
    size
        Size of the file [bytes].
    chunks
        Offsets of the chunks that the summary lists, in order; may be empty.
    report
        Reporter of damage.
    """

    def __init__(
        self, stream: BinaryIO, size: int, chunks: Sequence[int], report: DamageReport
    ) -> None:
        self._stream = stream
        self._size = size
        self._chunks = chunks
        self._report = report

    def __iter__(self) -> Iterator[McapRecord]:
        position: int | None = len(MAGIC)
        while position is not None:
            self._stream.seek(position)
            head = self._stream.read(RECORD.size)
            opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
            follows = position + RECORD.size + length
            if follows <= self._size and self._is_sound(opcode, length):
                if opcode == Opcode.FOOTER and self._ends_at(follows):
                    return
                if opcode >= _PRIVATE:
                    self._report_unknown(position, opcode, length)
                elif opcode != Opcode.FOOTER:
                    yield McapRecord(opcode, position, length)
                position = follows
                continue
            if (next_chunk := self._chunk_behind(position)) is None:
                self._report_cut(position)
                if opcode == Opcode.CHUNK and follows > self._size:
                    yield McapRecord(opcode, position, self._size - position - RECORD.size, False)
            position = next_chunk

    def _is_sound(self, opcode: int, length: int) -> bool:
        """Return whether a record of this kind may have this length."""
        is_known = opcode >= _PRIVATE or opcode in _KINDS
        is_long_enough = length >= _SMALLEST.get(opcode, 0)
        return is_known and is_long_enough and length == _SIZES.get(opcode, length)

    def _ends_at(self, position: int) -> bool:
        self._stream.seek(position)
        return self._stream.read(len(MAGIC) + 1) == MAGIC

    def _chunk_behind(self, position: int) -> int | None:
        """Return the offset of the next chunk that the summary lists; None if it lists none."""
        index = bisect_right(self._chunks, position)
        if index == len(self._chunks) or self._chunks[index] >= self._size:
            return None
        lost = self._chunks[index] - position
        self._report.add(f'the {lost} bytes from byte {position} on are damaged and ignored', lost)
        return self._chunks[index]

    def _report_cut(self, position: int) -> None:
        rest = self._size - position
        self._report.add(
            f'the file is cut off at byte {position} (the recorder may have been killed): the '
            f'reader uses only the complete messages in the last {rest} bytes',
            rest,
        )

    def _report_unknown(self, position: int, opcode: int, length: int) -> None:
        self._report.add(
            f'the reader ignores the record of {length} bytes at byte {position}, because its '
            f'kind {opcode} is unknown',
            length,
        )
