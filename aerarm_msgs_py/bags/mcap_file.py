"""Messages of one MCAP file, a chunk at a time.

The mcap package walks a file message by message, 3 us each. Here its record classes read
the few large records (chunk, channel, schema), and numpy finds the messages in a chunk by
the index behind it. An index that is missing or damaged is replaced by a short walk, and
the summary isn't needed, so files whose recorder was killed read as well as complete ones.
Format: https://mcap.dev/spec.
"""

import struct
import warnings
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema, Statistics

from aerarm_msgs_py.bags.bag_error import BagError, BagWarning
from aerarm_msgs_py.bags.mcap_chunk import ChunkError, beginning_of_records, chunk_records
from aerarm_msgs_py.bags.mcap_messages import MESSAGE_HEADER, RECORD, ChunkIndexes, walk
from aerarm_msgs_py.bags.message_block import MessageBlock
from aerarm_msgs_py.codecs.payloads import Payloads, elements_at

_MAGIC = b'\x89MCAP0\r\n'
# What the mcap package raises when a record is cut off or holds other than it should.
_DAMAGE = (McapError, struct.error, UnicodeDecodeError)
_LOOSE_LIMIT = 2**20  # bytes of messages outside chunks that are collected into a block
_NO_INDEX = ChunkIndexes()


class McapFile:
    """Reader of one file that was written by rosbag2, this suite or any MCAP writer.

    Parameters
    ----------
    path
        The .mcap file.

    Attributes
    ----------
    types
        Message type of every topic met while reading.
    damaged
        Whether reading met a missing end or damage.
    counts
        Messages of every topic by the file's own account, once it was read to its end; None
        if it has none, as after its recorder was killed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.types: dict[str, str] = {}
        self.damaged = False
        self.counts: dict[str, int] | None = None
        self._schemas: dict[int, str] = {0: ''}
        self._channels: dict[int, str] = {}

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all) in the order of the file.

        No more than one chunk is in memory; chunks without such messages aren't read. Damage
        and a missing end are warned about, and what is readable is read.

        Raises
        ------
        BagError
            If the file can't be opened, is empty or isn't MCAP.
        """
        try:
            with self.path.open('rb') as stream:
                self._check_magic(stream.read(len(_MAGIC)))
                for records, indexes in self._record_runs(stream, topics):
                    yield from self._blocks_of(records, indexes, topics)
        except OSError as error:
            raise BagError(f'{self.path} cannot be read: {error.strerror}') from error

    def _check_magic(self, found: bytes) -> None:
        if not found:
            raise BagError(
                f'{self.path} is empty: was its recorder stopped before it wrote anything, or '
                'the copy cut short? Record or copy it again'
            )
        if found != _MAGIC:
            raise BagError(f'{self.path} is not an MCAP file: check the path')

    def _record_runs(
        self, stream: BinaryIO, topics: Collection[str] | None
    ) -> Iterator[tuple[bytes, ChunkIndexes]]:
        """Yield runs of schema, channel and message records: chunks, or what lies between."""
        size = self.path.stat().st_size
        loose = bytearray()
        chunk: tuple[int, int, ChunkIndexes] | None = None  # start, length, index of the last
        start = len(_MAGIC)
        while True:
            head = stream.read(RECORD.size)
            opcode, length = RECORD.unpack(head) if len(head) == RECORD.size else (0, 0)
            follows = start + RECORD.size + length
            if opcode == Opcode.MESSAGE_INDEX and chunk and follows <= size:
                chunk[2].add(stream.read(length))
                start = follows
                continue
            if chunk:
                if self._is_wanted(chunk[2], topics):
                    yield self._chunk(stream, *chunk[:2]), chunk[2]
                    stream.seek(start + len(head))
                chunk = None
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self._read_summary(stream, start, size)
                break
            if opcode == 0 or follows > size:
                loose += self._cut_off(stream, opcode, size - start)
                break
            if opcode == Opcode.CHUNK:
                yield bytes(loose), _NO_INDEX
                loose.clear()
                chunk = (start, length, ChunkIndexes())
                stream.seek(follows)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                loose += head + stream.read(length)
                if len(loose) > _LOOSE_LIMIT:
                    yield bytes(loose), _NO_INDEX
                    loose.clear()
            else:
                stream.seek(follows)
            start = follows
        yield bytes(loose), _NO_INDEX

    def _read_summary(self, stream: BinaryIO, start: int, size: int) -> None:
        """Take the writer's own count of messages, which only a completed file has."""
        stream.seek(start)
        while len(head := stream.read(RECORD.size)) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            start += RECORD.size + length
            if start > size or opcode == Opcode.FOOTER:
                return
            if opcode == Opcode.STATISTICS:
                try:
                    content = ReadDataStream(BytesIO(stream.read(length)))
                    counts = Statistics.read(content).channel_message_counts
                except _DAMAGE:
                    return
                self.counts = {}
                for channel, topic in self._channels.items():
                    self.counts[topic] = self.counts.get(topic, 0) + counts.get(channel, 0)
                return
            stream.seek(start)

    def _is_wanted(self, indexes: ChunkIndexes, topics: Collection[str] | None) -> bool:
        """Tell whether a chunk may hold messages of some topics, or say what a channel is."""
        if topics is None or not (indexes.complete and indexes.channels):
            return True
        names = [self._channels.get(channel) for channel in indexes.channels]
        return any(name is None or name in topics for name in names)

    def _chunk(self, stream: BinaryIO, start: int, length: int) -> bytes:
        stream.seek(start + RECORD.size)
        try:
            return chunk_records(Chunk.read(ReadDataStream(BytesIO(stream.read(length)))))
        except (ChunkError, *_DAMAGE) as error:
            self._warn(f'is damaged: the chunk at byte {start} is left out, {error}')
            return b''

    def _cut_off(self, stream: BinaryIO, opcode: int, rest: int) -> bytes:
        """Return what can be had of the last record, whose end is missing."""
        self._warn(
            f'is cut off (was its recorder killed?): of its last {rest} bytes '
            'only complete messages are used'
        )
        if opcode != Opcode.CHUNK:
            return b''
        try:
            return beginning_of_records(Chunk.read(ReadDataStream(BytesIO(stream.read()))))
        except _DAMAGE:
            return b''

    def _blocks_of(
        self, records: bytes, indexes: ChunkIndexes, topics: Collection[str] | None
    ) -> Iterator[MessageBlock]:
        starts = indexes.message_starts(records)
        if starts is None:
            starts, definitions = walk(records)
            for opcode, content in definitions:
                self._register(opcode, content)
        headers = elements_at(records, MESSAGE_HEADER, starts)
        for channel in np.unique(headers['channel']).tolist():
            topic = self._channels.get(channel)
            if topic is None or (topics is not None and topic not in topics):
                continue
            own = headers['channel'] == channel
            mine = headers[own]
            payload_sizes = mine['length'].astype(np.int64) + RECORD.size - MESSAGE_HEADER.itemsize
            yield MessageBlock(
                topic,
                self.types[topic],
                mine['log_time'].astype(np.int64),
                mine['sequence'].astype(np.int64),
                Payloads(records, starts[own] + MESSAGE_HEADER.itemsize, payload_sizes),
            )

    def _register(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self._schemas[schema.id] = schema.name
            else:
                channel = Channel.read(stream)
                self._channels[channel.id] = channel.topic
                self.types[channel.topic] = self._schemas.get(channel.schema_id, '')
        except _DAMAGE as error:
            self._warn(f'is damaged: the record of a topic is left out, {error}')

    def _warn(self, what: str) -> None:
        self.damaged = True
        warnings.warn(f'{self.path} {what}', BagWarning, stacklevel=2)
