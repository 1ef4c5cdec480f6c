"""Reader of one MCAP file, chunk by chunk.

The mcap package reads message by message (3 us each) and does not check the sizes that a file
declares. This module scans a whole chunk and decodes its messages with numpy. It does not need the
summary at the end of the file, so it also reads files of killed recorders. Format:
https://mcap.dev/spec.
"""

import contextlib
import os
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.codecs.cdr import Payloads, elements_at
from aerarm_msgs_py.storage.compressed_file import BagFile
from aerarm_msgs_py.storage.mcap_records import McapTopics, RecordFields, read_chunk
from aerarm_msgs_py.storage.mcap_walk import (
    MAGIC,
    MESSAGE_HEADER,
    RECORD,
    McapRecord,
    McapSummary,
    McapWalk,
    indexed_messages,
    read_counts,
    read_summary,
    walk,
)
from aerarm_msgs_py.storage.read_limits import (
    BagError,
    DamageReport,
    MessageBlock,
    ReadBudget,
    reading,
)

_LOOSE_LIMIT = 2**20  # bytes per block of messages outside chunks
_LOOSE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)


class RecordRun(NamedTuple):
    """Consecutive schema, channel and message records, from one chunk or outside of chunks."""

    records: bytes
    place: str = ''  # of a complete chunk
    indexed: int = 0  # messages that the index after the chunk lists


class McapFile(BagFile):
    """Reader of one MCAP file, whichever program wrote it.

    `counts` is None if the file does not state them, for example if the recorder was killed.
    """

    def __init__(self, path: Path, budget: ReadBudget) -> None:
        super().__init__(path, budget)
        self._begin(McapSummary())

    def _begin(self, summary: McapSummary) -> None:
        self._summary = summary
        self._report = DamageReport(self.path)
        self._topics = McapTopics(summary.channels, self._report)
        self._digests: set[tuple[bytes, int, int]] = set()  # of the chunks so far

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield blocks of messages of `topics` in file order; None selects all topics.

        At most one chunk is in memory. Damage and a truncated end cause warnings. The reader
        returns each readable message once.

        Raises
        ------
        BagError
            If the file cannot be opened, is empty or not MCAP, or would exceed the memory limit.
        """
        with reading(self.path), self.path.open('rb') as stream:
            size = os.fstat(stream.fileno()).st_size
            self._check_magic(stream.read(len(MAGIC)))
            self._begin(read_summary(stream, size, self._budget.part_bytes))
            for run in self._runs(stream, size):
                yield from self._blocks_of(run, topics)
        self._report.finish()

    def _check_magic(self, found: bytes) -> None:
        if not found:
            raise BagError(
                f'the file {self.path} is empty: record or copy the bag again (the recorder '
                'stopped before it wrote anything, or the copy was interrupted)'
            )
        if found != MAGIC:
            raise BagError(f'the file {self.path} is not an MCAP file: check the path')

    def _runs(self, stream: BinaryIO, size: int) -> Iterator[RecordRun]:
        loose = bytearray()
        chunk: McapRecord | None = None  # the last one, until the end of its index is known
        indexed = 0
        for record in McapWalk(stream, size, self._summary.chunks, self._report):
            if record.opcode == Opcode.MESSAGE_INDEX:
                indexed += self._indexed(stream, record, chunk)
                continue
            if chunk:
                yield from self._chunk(stream, chunk, indexed)
            chunk, indexed = None, 0
            if record.opcode == Opcode.CHUNK:
                yield RecordRun(bytes(loose))
                loose.clear()
                chunk = record
            elif record.opcode in _LOOSE:
                content = self._content(stream, record)
                loose += RECORD.pack(record.opcode, len(content)) + content if content else b''
                if len(loose) > _LOOSE_LIMIT:
                    yield RecordRun(bytes(loose))
                    loose.clear()
            elif record.opcode == Opcode.STATISTICS:
                self._take_counts(self._content(stream, record))
        if chunk:
            yield from self._chunk(stream, chunk, indexed)
        yield RecordRun(bytes(loose))

    def _indexed(self, stream: BinaryIO, record: McapRecord, chunk: McapRecord | None) -> int:
        """Return how many messages of a chunk an index record lists; report a wrong index."""
        count = indexed_messages(self._content(stream, record))
        if count is None:
            self._report.add(
                f'the index of {record.length} bytes at byte {record.start} is damaged',
                record.length,
            )
        elif count and not chunk:
            self._report.add(
                f'{count} messages are lost: the file contains only their index, at byte '
                f'{record.start}'
            )
        return count or 0

    def _take_counts(self, content: bytes) -> None:
        """Read the message counts from a statistics record outside the summary."""
        if self._summary.counts is None:
            with contextlib.suppress(ValueError):
                self._summary.counts = read_counts(RecordFields(content))

    def _content(self, stream: BinaryIO, record: McapRecord) -> bytes:
        """Return the content of a record; empty if it exceeds the limit `part_bytes`."""
        most = self._budget.part_bytes
        if record.length > most:
            self._report.add(
                f'the reader ignores the record at byte {record.start}, because its '
                f'{record.length} bytes exceed the limit of {most} bytes per record '
                '(limits part_bytes and ratio)',
                record.length,
            )
            return b''
        stream.seek(record.start + RECORD.size)
        return stream.read(record.length)

    def _chunk(self, stream: BinaryIO, record: McapRecord, indexed: int) -> Iterator[RecordRun]:
        """Yield the records of an intact chunk; report a damaged or repeated chunk."""
        place = f'the chunk at byte {record.start}'
        listed = f' with {indexed} messages' if indexed else ''
        try:
            content = self._content(stream, record)
            chunk = read_chunk(content, self._budget, whole=record.whole)
        except BagError:
            raise
        except ValueError as error:
            if record.whole:  # otherwise the truncated end was reported
                self._report.add(
                    f'{place}{listed} ({record.length} bytes) is damaged and ignored: {error}',
                    record.length,
                )
            return
        if chunk.digest in self._digests:
            self._report.add(
                f'{place}{listed} ({record.length} bytes) is stored twice: the reader returns its '
                'messages once'
            )
            return
        self._digests.add(chunk.digest)
        yield RecordRun(chunk.records, *((place, indexed) if record.whole else ()))

    def _blocks_of(self, run: RecordRun, topics: Collection[str] | None) -> Iterator[MessageBlock]:
        records = run.records
        starts, definitions, unread = walk(records, self._budget)
        for opcode, content in definitions:
            self._topics.register(opcode, content)
        self.types = self._topics.types
        self.counts = self._topics.by_topic(self._summary.counts)
        if unread and run.place:
            self._report.add(
                f'in {run.place}, the {unread} bytes after {len(starts)} messages are not '
                'messages and are ignored',
                unread,
            )
        if run.indexed and run.indexed != len(starts):
            self._report.add(
                f'the index after {run.place} lists {run.indexed} messages, but the chunk contains '
                f'{len(starts)} messages'
            )
        headers = elements_at(records, MESSAGE_HEADER, starts)
        for topic, own in self._topics.groups(headers['channel']):
            if not topic:
                self._report.add(f'the reader ignores {len(own)} messages without a known topic')
            elif topics is None or topic in topics:
                yield from self._block(topic, records, headers[own], starts[own]).parts()

    def _block(
        self, topic: str, records: bytes, headers: NDArray[np.void], starts: NDArray[np.int64]
    ) -> MessageBlock:
        payload_sizes = headers['length'].astype(np.int64) + RECORD.size - MESSAGE_HEADER.itemsize
        return MessageBlock(
            topic,
            self._topics.types[topic],
            headers['log_time'].astype(np.int64),
            headers['sequence'].astype(np.int64),
            Payloads(records, starts + MESSAGE_HEADER.itemsize, payload_sizes),
        )
