"""From record to record through an MCAP file, over damage where there is a way."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import BinaryIO, NamedTuple

from mcap.opcode import Opcode

from aerarm_msgs_py.storage.damage_report import DamageReport
from aerarm_msgs_py.storage.mcap_messages import MESSAGE_HEADER, RECORD
from aerarm_msgs_py.storage.mcap_summary import FOOTER_SIZE, MAGIC

_PRIVATE = 128  # from here on, opcodes are anybody's
_SMALLEST_CHUNK = 40  # bytes of its fields
_OF_SUMMARY = (
    Opcode.STATISTICS,
    Opcode.CHUNK_INDEX,
    Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
    Opcode.SUMMARY_OFFSET,
)
_IN_DATA = (
    Opcode.HEADER,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.MESSAGE,
    Opcode.CHUNK,
    Opcode.MESSAGE_INDEX,
    Opcode.ATTACHMENT,
    Opcode.METADATA,
    Opcode.DATA_END,
)
_SMALLEST = {Opcode.CHUNK: _SMALLEST_CHUNK, Opcode.MESSAGE: MESSAGE_HEADER.itemsize - RECORD.size}


class McapRecord(NamedTuple):
    """One record of a file.

    Attributes
    ----------
    opcode
        What it is.
    start
        Byte at which it begins.
    length
        Bytes of its content.
    whole
        False for a last record whose end is missing.
    """

    opcode: int
    start: int
    length: int
    whole: bool = True


class McapWalk:
    """The records of a file between its magic bytes, in order.

    Where a record can't be one, the walk goes on at the next chunk that the summary knows;
    without one it ends there. Both are reported.

    Parameters
    ----------
    stream
        The file.
    size
        Its bytes.
    chunks
        Where chunks begin by the file's summary, in order; may be empty.
    report
        Takes what is damaged.
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
        in_summary = False
        while position is not None:
            self._stream.seek(position)
            head = self._stream.read(RECORD.size)
            opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
            follows = position + RECORD.size + length
            sound = follows <= self._size and self._is_sound(opcode, length, in_summary)
            if sound and opcode == Opcode.FOOTER:
                if self._ends_at(follows):
                    return
                sound = False
            if sound:
                in_summary = in_summary or opcode == Opcode.DATA_END
                if opcode < _PRIVATE:
                    yield McapRecord(opcode, position, length)
                else:
                    self._tell_private(position, opcode, length)
                position = follows
                continue
            if (next_chunk := self._chunk_behind(position)) is None:
                self._tell_cut(position)
                if opcode == Opcode.CHUNK and follows > self._size:
                    yield McapRecord(opcode, position, self._size - position - RECORD.size, False)
            position = next_chunk

    def _is_sound(self, opcode: int, length: int, in_summary: bool) -> bool:
        """Tell whether there may be a record of that kind and length here."""
        if opcode == Opcode.FOOTER:
            return length == FOOTER_SIZE
        if opcode == Opcode.DATA_END:
            return length == 4
        if opcode in _OF_SUMMARY:
            return in_summary
        return opcode >= _PRIVATE or opcode in _IN_DATA and length >= _SMALLEST.get(opcode, 0)

    def _ends_at(self, position: int) -> bool:
        self._stream.seek(position)
        return self._stream.read(len(MAGIC) + 1) == MAGIC

    def _chunk_behind(self, position: int) -> int | None:
        """Return where the next chunk begins, by the file's summary; None without one."""
        index = bisect_right(self._chunks, position)
        if index == len(self._chunks) or self._chunks[index] >= self._size:
            return None
        lost = self._chunks[index] - position
        self._report.tell(f'is damaged: {lost} bytes at byte {position} are left out', lost)
        return self._chunks[index]

    def _tell_cut(self, position: int) -> None:
        rest = self._size - position
        self._report.tell(
            f'is cut off at byte {position} (was its recorder killed?): of its last {rest} bytes '
            'only complete messages are used',
            rest,
        )

    def _tell_private(self, position: int, opcode: int, length: int) -> None:
        self._report.tell(
            f'holds a record of the unknown kind {opcode} at byte {position}: its {length} bytes '
            'are left out',
            length,
        )
