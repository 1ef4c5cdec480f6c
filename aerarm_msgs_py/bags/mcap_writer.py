"""Writer of MCAP files that are complete and readable after every chunk.

The writer of the mcap package writes the closing records of a file only when the file is closed.
The writer of this module also writes short closing records after every chunk, which the next chunk
overwrites. Any MCAP reader can therefore open the file of a killed recorder. Format:
https://mcap.dev/spec.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BufferedRandom, BufferedWriter

import yaml
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, DataEnd, Footer, Schema
from mcap.writer import CompressionType, Writer

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


COMPRESSIONS = {
    'none': CompressionType.NONE,
    'lz4': CompressionType.LZ4,
    'zstd': CompressionType.ZSTD,
}
_MAGIC = b'\x89MCAP0\r\n'
_SEQUENCE_MASK = 2**32 - 1
_UNLIMITED = 2**62  # bytes of a chunk, which ends with the messages of a call


class McapWriter:
    """Writer that appends messages to an MCAP file, chunk by chunk.

    Parameters
    ----------
    stream
        Empty file.
    topics
        All topics of the file; messages refer to them by index.
    compression
        'zstd', 'lz4' or 'none'.
    """

    def __init__(
        self,
        stream: BufferedWriter | BufferedRandom,
        topics: Sequence[RecordedTopic],
        compression: str = 'zstd',
    ) -> None:
        self._stream = stream
        self._writer = Writer(stream, _UNLIMITED, COMPRESSIONS[compression])
        self._writer.start('ros2', 'aerarm_ros')
        # The definitions precede the first chunk, whose damage must not affect the other chunks.
        definitions = RecordBuilder()
        schemas: dict[str, int] = {}
        for kind in dict.fromkeys(topic.type for topic in topics):
            text = message_definition(kind).text
            encoding, data = 'ros2msg' if text else '', text.encode()
            schemas[kind] = self._writer.register_schema(kind, encoding, data)
            Schema(id=schemas[kind], name=kind, encoding=encoding, data=data).write(definitions)
        self._channels = []
        for topic in topics:
            metadata = {
                'offered_qos_profiles': yaml.safe_dump([topic.qos_profile()], sort_keys=False),
                'topic_type_hash': message_definition(topic.type).hash,
            }
            number = self._writer.register_channel(topic.name, 'cdr', schemas[topic.type], metadata)
            self._channels.append(number)
            Channel(
                id=number,
                topic=topic.name,
                message_encoding='cdr',
                metadata=metadata,
                schema_id=schemas[topic.type],
            ).write(definitions)
        stream.write(definitions.end())
        self._close()

    def add_chunk(self, messages: Sequence[RecordedMessage]) -> None:
        """Write messages as one chunk; the chunk stays readable even if the process is killed."""
        for topic, payload, log_time, publish_time, sequence in messages:
            number = sequence & _SEQUENCE_MASK
            channel = self._channels[topic]
            self._writer.add_message(channel, log_time, payload, publish_time, number)
        self._writer.flush()
        self._close()

    def finish(self, metadata: str) -> None:
        """Write the metadata of rosbag2, and the summary, in which readers find the chunks."""
        self._writer.add_metadata('rosbag2', {'serialized_metadata': metadata})
        self._writer.finish()
        self._stream.flush()

    def _close(self) -> None:
        """Write short closing records, and go back to the place of the next chunk."""
        place = self._stream.tell()
        builder = RecordBuilder()
        DataEnd(0).write(builder)
        Footer(0, 0, 0).write(builder)
        self._stream.write(builder.end() + _MAGIC)
        self._stream.flush()
        self._stream.seek(place)
