"""Readers of the records of an MCAP file: fields of a record, chunks, topics."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.storage.compressed_file import (
    DecompressionError,
    beginning,
    check_claim,
    decompress,
)
from aerarm_msgs_py.storage.read_limits import BagError, DamageReport, ReadBudget


class RecordFields:
    """Reader of the fields of one record (little-endian), in order.

    Every method raises ValueError if the record ends too early or a text is not UTF-8.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self.position = 0

    @property
    def left(self) -> int:
        """Number of bytes that have not been read yet."""
        return len(self._content) - self.position

    def number(self, size: int) -> int:
        """Read an unsigned number of `size` bytes."""
        return int.from_bytes(self.take(size), 'little')

    def text(self) -> str:
        """Read a UTF-8 text, which begins with its length as a number of 4 bytes."""
        return self.take(self.number(4)).decode()

    def take(self, size: int) -> bytes:
        """Read the next `size` bytes."""
        if size > self.left:
            raise ValueError(f'the record is {size - self.left} bytes too short')
        self.position += size
        return self._content[self.position - size : self.position]


class ChunkError(ValueError):
    """A chunk of an MCAP file is damaged."""


@dataclass(frozen=True)
class McapChunk:
    """Content of a chunk record of an MCAP file.

    Attributes
    ----------
    compression
        'zstd', 'lz4', or '' for no compression.
    size
        Declared size of the uncompressed records [bytes].
    crc
        Checksum of the uncompressed records; 0 for none.
    data
        Compressed records; fewer than `data_size` bytes if the chunk is truncated.
    data_size
        Declared size of the compressed records [bytes].
    """

    compression: str
    size: int
    crc: int
    data: bytes
    data_size: int

    @classmethod
    def read(cls, content: bytes) -> 'McapChunk':
        """Parse a chunk record.

        Raises
        ------
        ChunkError
            If the record ends before its data begins.
        """
        fields = RecordFields(content)
        try:
            fields.take(16)  # first and last time, which the messages contain too
            size, crc = fields.number(8), fields.number(4)
            compression, data_size = fields.text(), fields.number(8)
        except ValueError as error:
            raise ChunkError(str(error)) from None
        return cls(compression, size, crc, fields.take(min(data_size, fields.left)), data_size)

    def records(self, budget: ReadBudget) -> bytes:
        """Return the decompressed records of a complete chunk.

        Raises
        ------
        ChunkError
            If the data is damaged, its size differs from the declared size, or the checksum is
            wrong.
        BagError
            If the records exceed the remaining limits of the bag.
        """
        try:
            if len(self.data) < self.data_size:
                raise ChunkError(f'the chunk is {self.data_size - len(self.data)} bytes too short')
            if self.size > budget.part_bytes:
                raise ChunkError(
                    f'the chunk states a size of {self.size} bytes, above the limit of '
                    f'{budget.part_bytes} bytes (see the bag limits part_bytes and ratio)'
                )
            check_claim(self.data, self.compression, self.size)
            if self.compression:
                budget.spend(self.size)
            records = decompress(self.data, self.compression, self.size)
        except DecompressionError as error:
            raise ChunkError(str(error)) from None
        if self.crc and zlib.crc32(records) != self.crc:
            raise ChunkError('the content of the chunk does not match its checksum')
        return records

    def beginning(self, budget: ReadBudget) -> bytes:
        """Return the decompressed beginning of a truncated chunk; may be empty."""
        most = min(self.size, budget.part_bytes)
        budget.spend(most if self.compression else 0)
        return beginning(self.data, self.compression, most)


_CHANNELS = 2**16
MOST_TOPICS = 4096
"""Largest accepted number of topics in a file; a file with more topics is rejected."""

_NONE = -1
_CONTRADICTED = -2


class McapTopics:
    """Topics and message types, from the schema and channel records read so far.

    Parameters
    ----------
    channels
        Topic of each channel according to the summary of the file. If a channel record contradicts
        the summary, the topic of this channel is unknown.
    report
        Reporter of damage.

    Attributes
    ----------
    names
        Names of the topics found so far.
    types
        Message type of each topic, by name.
    """

    def __init__(self, channels: dict[int, str], report: DamageReport) -> None:
        self.names: list[str] = []
        self.types: dict[str, str] = {}
        self._places: dict[str, int] = {}
        self._schemas: dict[int, str] = {0: ''}
        self._claimed = dict(channels)
        self._index = np.full(_CHANNELS, _NONE, np.int32)
        self._report = report

    def register(self, opcode: int, content: bytes) -> None:
        """Process a schema or channel record.

        Raises
        ------
        BagError
            If the number of topics exceeds any plausible value.
        """
        fields = RecordFields(content)
        try:
            number = fields.number(2)
            if opcode == Opcode.SCHEMA:
                self._schemas[number] = fields.text()
                return
            schema = fields.number(2)
            topic = fields.text()
        except ValueError as error:
            self._report.add(
                f'the reader ignores a damaged definition of a topic or message type ({error})'
            )
            return
        if self._claimed.setdefault(number, topic) != topic:
            self._contradict(number, topic)
        elif self._index[number] != _CONTRADICTED:
            self._index[number] = self._place(topic, self._schemas.get(schema, ''))

    def groups(self, channels: NDArray[np.uint16]) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Yield, for each topic, its index in `names` and the indices of its messages.

        The index is negative for messages of an unknown topic.

        Parameters
        ----------
        channels
            (K,) channels of the messages.
        """
        if not len(channels):
            return
        places = self._index[channels]
        order = np.argsort(places, kind='stable')
        found, firsts = np.unique(places[order], return_index=True)
        yield from zip(found.tolist(), np.split(order, firsts[1:]), strict=True)

    def by_topic(self, counts: dict[int, int]) -> dict[str, int]:
        """Convert numbers of messages per channel to numbers of messages per topic."""
        found = dict.fromkeys(self.names, 0)
        for channel, count in counts.items():
            topic = self._claimed.get(channel, '')
            found[topic] = found.get(topic, 0) + count
        return found

    def _contradict(self, number: int, topic: str) -> None:
        if self._index[number] != _CONTRADICTED:
            self._report.add(
                f'channel {number} has the two topics {self._claimed[number][:200]} and '
                f'{topic[:200]}; the reader ignores its messages'
            )
        self._index[number] = _CONTRADICTED

    def _place(self, topic: str, kind: str) -> int:
        if topic not in self.types:
            if len(self.names) == MOST_TOPICS:
                raise BagError(
                    f'the bag has more than {MOST_TOPICS} topics: check whether it is damaged'
                )
            self._places[topic] = len(self.names)
            self.names.append(topic)
        self.types[topic] = kind
        return self._places[topic]
