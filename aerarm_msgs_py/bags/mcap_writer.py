"""Writer of MCAP files that are complete and readable after every chunk.

The writer of the mcap package ends a chunk only when the chunk has a certain size. Messages of a
slow topic could stay in memory for minutes, and the file lacks its closing records until it is
closed. The writer of this module uses the record classes of the mcap package, but ends a chunk on
request. After every chunk it writes short closing records, which the next chunk overwrites. Any
MCAP reader can therefore open the file of a killed recorder. Format: https://mcap.dev/spec.
"""

import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import BinaryIO

import lz4.frame
import yaml
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic


@dataclass(frozen=True)
class MessageDefinition:
    """Definition of a ROS message type, in the form that MCAP files contain.

    Attributes
    ----------
    text
        Text of the .msg file and of those of all nested types; '' for an unknown type.
    hash
        Type hash (REP 2016), '' for an unknown type.
    """

    text: str
    hash: str


@lru_cache
def message_definition(message_type: str) -> MessageDefinition:
    """Return the definition of a message type of ROS 2 Jazzy, for example 'std_msgs/msg/String'."""
    # Imported here, because it takes 0.1 s and readers do not need it.
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type not in store.fielddefs:
        return MessageDefinition('', '')
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return MessageDefinition(text, store.hash_rihs01(message_type))


_MAGIC = b'\x89MCAP0\r\n'
_MESSAGE = struct.Struct('<BQHIQQ')  # opcode, length, channel, sequence, log, publish time
_MESSAGE_FIELDS = _MESSAGE.size - 9
_SEQUENCE_MASK = 2**32 - 1

COMPRESSIONS: dict[str, Callable[[bytes], bytes]] = {
    'none': lambda data: data,
    'lz4': lz4.frame.compress,
    'zstd': lambda data: zstandard.compress(data, 1),
}


class McapWriter:
    """Writer that appends messages to an MCAP file, chunk by chunk.

    Parameters
    ----------
    stream
        Empty file, opened for unbuffered writing.
    topics
        All topics of the file; messages refer to them by index.
    compression
        'zstd', 'lz4' or 'none'.
    """

    def __init__(
        self, stream: BinaryIO, topics: Sequence[RecordedTopic], compression: str = 'zstd'
    ) -> None:
        self._stream = stream
        self._compress = COMPRESSIONS[compression]
        self._compression = '' if compression == 'none' else compression
        self._schemas = _schemas(topics)
        ids = {schema.name: schema.id for schema in self._schemas}
        self._channels = [_channel(k, topic, ids[topic.type]) for k, topic in enumerate(topics, 1)]
        self._chunks: list[ChunkIndex] = []
        self._counts = {channel.id: 0 for channel in self._channels}
        builder = RecordBuilder()
        builder.write(_MAGIC)
        Header(profile='ros2', library='aerarm_ros').write(builder)
        self._write_definitions(builder)
        self._end = 0
        self._append(builder.end())

    def add_chunk(self, messages: Sequence[RecordedMessage]) -> None:
        """Write messages as one chunk; the chunk stays readable even if the process is killed."""
        records, indices = self._records(messages)
        data = self._compress(records)
        start = min(message.log_time for message in messages)
        end = max(message.log_time for message in messages)
        builder = RecordBuilder()
        Chunk(
            compression=self._compression,
            data=data,
            message_start_time=start,
            message_end_time=end,
            uncompressed_crc=zlib.crc32(records),
            uncompressed_size=len(records),
        ).write(builder)
        chunk_length = builder.count
        offsets = {}
        for index in indices:
            offsets[index.channel_id] = self._end + builder.count
            index.write(builder)
            self._counts[index.channel_id] += len(index.records)
        self._chunks.append(
            ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=self._end,
                compression=self._compression,
                compressed_size=len(data),
                message_start_time=start,
                message_end_time=end,
                message_index_length=builder.count - chunk_length,
                message_index_offsets=offsets,
                uncompressed_size=len(records),
            )
        )
        self._append(builder.end())

    def finish(self, metadata: str) -> None:
        """Write the metadata of rosbag2, and the summary, in which readers find the chunks."""
        builder = RecordBuilder()
        Metadata('rosbag2', {'serialized_metadata': metadata}).write(builder)
        index = MetadataIndex(offset=self._end, length=builder.count, name='rosbag2')
        DataEnd(0).write(builder)
        summary_start = self._end + builder.count
        groups = [self._schemas, self._channels, [self._statistics()], self._chunks, [index]]
        offsets = []
        for group in groups:
            start = self._end + builder.count
            for record in group:
                record.write(builder)
            length = self._end + builder.count - start
            if length:
                offsets.append(SummaryOffset(_OPCODES[type(group[0])], start, length))
        offset_start = self._end + builder.count
        for offset in offsets:
            offset.write(builder)
        Footer(summary_start, offset_start, 0).write(builder)
        builder.write(_MAGIC)
        self._put(builder.end())

    def _records(self, messages: Sequence[RecordedMessage]) -> tuple[bytes, list[MessageIndex]]:
        parts: list[bytes] = []
        indices: dict[int, MessageIndex] = {}
        offset = 0
        for topic, payload, log_time, publish_time, sequence in messages:
            channel = topic + 1
            length = len(payload) + _MESSAGE_FIELDS
            number = sequence & _SEQUENCE_MASK
            parts.append(
                _MESSAGE.pack(Opcode.MESSAGE, length, channel, number, log_time, publish_time)
            )
            parts.append(payload)
            if channel not in indices:
                indices[channel] = MessageIndex(channel, [])
            indices[channel].records.append((log_time, offset))
            offset += 9 + length
        return b''.join(parts), list(indices.values())

    def _append(self, data: bytes) -> None:
        """Append data and new closing records to the file, in place of the old closing records."""
        builder = RecordBuilder()
        DataEnd(0).write(builder)
        Footer(0, 0, 0).write(builder)
        self._put(data + builder.end() + _MAGIC)
        self._end += len(data)

    def _put(self, data: bytes) -> None:
        self._stream.seek(self._end)
        rest = memoryview(data)
        while rest:
            rest = rest[self._stream.write(rest) :]

    def _write_definitions(self, builder: RecordBuilder) -> None:
        for record in (*self._schemas, *self._channels):
            record.write(builder)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            metadata_count=1,
            schema_count=len(self._schemas),
        )


_OPCODES = {
    Schema: Opcode.SCHEMA,
    Channel: Opcode.CHANNEL,
    Statistics: Opcode.STATISTICS,
    ChunkIndex: Opcode.CHUNK_INDEX,
    MetadataIndex: Opcode.METADATA_INDEX,
}


def _schemas(topics: Sequence[RecordedTopic]) -> list[Schema]:
    schemas = []
    for number, kind in enumerate(dict.fromkeys(topic.type for topic in topics), 1):
        text = message_definition(kind).text
        schemas.append(
            Schema(id=number, data=text.encode(), encoding='ros2msg' if text else '', name=kind)
        )
    return schemas


def _channel(number: int, topic: RecordedTopic, schema_id: int) -> Channel:
    return Channel(
        id=number,
        topic=topic.name,
        message_encoding='cdr',
        metadata={
            'offered_qos_profiles': yaml.safe_dump([topic.qos_profile()], sort_keys=False),
            'topic_type_hash': message_definition(topic.type).hash,
        },
        schema_id=schema_id,
    )
