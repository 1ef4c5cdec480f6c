"""Messages of one MCAP file, a chunk at a time.

The mcap package walks a file message by message, 3 us each. Here its record classes read
the few large records (chunk, channel, schema), and a short walk inside a chunk finds the
messages asked for; index records and the summary aren't needed, so files whose recorder
was killed read as well as complete ones. Format: https://mcap.dev/spec.
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
from mcap.records import Channel, Chunk, Schema

from aerarm_msgs_py.bag_error import BagError, BagWarning
from aerarm_msgs_py.mcap_chunk import ChunkError, beginning_of_records, chunk_records
from aerarm_msgs_py.message_block import MessageBlock

_MAGIC = b'\x89MCAP0\r\n'
_RECORD = struct.Struct('<BQ')  # opcode, length
_MESSAGE = struct.Struct('<BQH')  # opcode, length, channel of a message
_MESSAGE_HEADER = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)
_HEADER_SIZE = _MESSAGE_HEADER.itemsize
# What the mcap package raises when a record is cut off or holds other than it should.
_DAMAGE = (McapError, struct.error, UnicodeDecodeError)
_LOOSE_LIMIT = 2**20  # bytes of messages outside chunks that are collected into a block


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
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.types: dict[str, str] = {}
        self._schemas: dict[int, str] = {0: ''}
        self._channels: dict[int, str] = {}

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all) in the order of the file.

        No more than one chunk is in memory. Damage and a missing end are warned about, and
        what is readable is read.

        Raises
        ------
        BagError
            If the file can't be opened or isn't MCAP.
        """
        try:
            with self.path.open('rb') as stream:
                if stream.read(len(_MAGIC)) != _MAGIC:
                    raise BagError(f'{self.path} is not an MCAP file: check the path')
                for records in self._record_runs(stream):
                    yield from self._blocks_of(records, topics)
        except OSError as error:
            raise BagError(f'{self.path} cannot be read: {error.strerror}') from error

    def _record_runs(self, stream: BinaryIO) -> Iterator[bytes]:
        """Yield runs of schema, channel and message records: chunks, or what lies between."""
        size = self.path.stat().st_size
        loose = bytearray()
        while True:
            start = stream.tell()
            head = stream.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, 0)
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                break
            if opcode == 0 or length > size - stream.tell():
                if opcode == Opcode.CHUNK:
                    loose += self._beginning_of_chunk(stream.read())
                self._warn(
                    f'is cut off (was its recorder killed?): of its last {size - start} bytes '
                    'only complete messages are used'
                )
                break
            if opcode == Opcode.CHUNK:
                yield bytes(loose)
                loose.clear()
                yield self._chunk(stream.read(length), start)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
                loose += head + stream.read(length)
                if len(loose) > _LOOSE_LIMIT:
                    yield bytes(loose)
                    loose.clear()
            else:
                stream.seek(length, 1)
        yield bytes(loose)

    def _chunk(self, content: bytes, start: int) -> bytes:
        try:
            return chunk_records(Chunk.read(ReadDataStream(BytesIO(content))))
        except (ChunkError, *_DAMAGE) as error:
            self._warn(f'is damaged: the chunk at byte {start} is left out, {error}')
            return b''

    def _beginning_of_chunk(self, content: bytes) -> bytes:
        try:
            return beginning_of_records(Chunk.read(ReadDataStream(BytesIO(content))))
        except _DAMAGE:
            return b''

    def _blocks_of(self, records: bytes, topics: Collection[str] | None) -> Iterator[MessageBlock]:
        starts = self._starts_by_channel(topics)
        position = 0
        last = len(records) - _MESSAGE.size
        unpack = _MESSAGE.unpack_from
        message = int(Opcode.MESSAGE)  # comparing with the enumeration takes longer
        while position <= last:
            opcode, length, channel = unpack(records, position)
            end = position + _RECORD.size + length
            if opcode == message:
                found = starts.get(channel)
                if found is not None and position + _HEADER_SIZE <= end <= len(records):
                    found.append(position)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and end <= len(records):
                self._register(opcode, records[position + _RECORD.size : end])
                starts = {**self._starts_by_channel(topics), **starts}
            position = end
        for channel, positions in starts.items():
            if positions:
                yield self._block(self._channels[channel], records, positions)

    def _starts_by_channel(self, topics: Collection[str] | None) -> dict[int, list[int]]:
        """Return an empty list for every channel that is wanted among those known so far."""
        known = self._channels.items()
        return {channel: [] for channel, topic in known if topics is None or topic in topics}

    def _block(self, topic: str, records: bytes, starts: list[int]) -> MessageBlock:
        at = np.array(starts)
        bytes_of_headers = np.frombuffer(records, np.uint8)[at[:, None] + np.arange(_HEADER_SIZE)]
        headers = bytes_of_headers.view(_MESSAGE_HEADER)[:, 0]
        ends = (at + _RECORD.size + headers['length'].astype(np.int64)).tolist()
        return MessageBlock(
            topic,
            self.types[topic],
            headers['log_time'].astype(np.int64),
            headers['sequence'].astype(np.int64),
            [records[a + _HEADER_SIZE : b] for a, b in zip(starts, ends, strict=True)],
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
        warnings.warn(f'{self.path} {what}', BagWarning, stacklevel=2)
