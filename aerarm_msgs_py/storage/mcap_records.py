"""Records of an MCAP file: fields, chunks and topics."""

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
    """Cursor over the content of one little-endian record.

    Every method raises ValueError if the record ends too early or a text is not UTF-8.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self.position = 0

    @property
    def left(self) -> int:
        """Number of bytes after the cursor."""
        return len(self._content) - self.position

    def number(self, size: int) -> int:
        """Read an unsigned number of `size` bytes."""
        return int.from_bytes(self.take(size), 'little')

    def text(self) -> str:
        """Read a text: its length as a number of 4 bytes, then its UTF-8 bytes."""
        return self.take(self.number(4)).decode()

    def take(self, size: int) -> bytes:
        """Read `size` bytes."""
        if size > self.left:
            raise ValueError(f'the record is {size - self.left} bytes too short')
        self.position += size
        return self._content[self.position - size : self.position]


class ChunkError(ValueError):
    """The chunk is damaged."""


@dataclass(frozen=True)
class McapChunk:
    """Chunk record of an MCAP file.

    Attributes
    ----------
    compression
        'zstd', 'lz4' or '' for none.
    size
        Declared size of the uncompressed records [bytes].
    crc
        Checksum of the records; 0 for none.
    data
        The records, compressed; fewer than `data_size` bytes if the chunk is truncated.
    data_size
        Size of the compressed records [bytes].
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
        """Return the records of a complete chunk, decompressed within the limits.

        Raises
        ------
        ChunkError
            If the size differs from the declared one, the data is damaged or the checksum wrong.
        BagError
            If the limits of the bag are exceeded.
        """
        try:
            if len(self.data) < self.data_size:
                raise ChunkError(f'the chunk is {self.data_size - len(self.data)} bytes too short')
            if self.size > budget.part_bytes:
                raise ChunkError(
                    f'the chunk states a size of {self.size} bytes, above the limit of '
                    f'{budget.part_bytes} bytes (limits part_bytes and ratio)'
                )
            check_claim(self.data, self.compression, self.size)
            if self.compression:
                budget.spend(self.size)
            records = decompress(self.data, self.compression, self.size)
        except DecompressionError as error:
            raise ChunkError(str(error)) from None
        if self.crc and zlib.crc32(records) != self.crc:
            raise ChunkError('wrong checksum')
        return records

    def beginning(self, budget: ReadBudget) -> bytes:
        """Return the readable start of a truncated chunk, possibly nothing."""
        most = min(self.size, budget.part_bytes)
        budget.spend(most if self.compression else 0)
        return beginning(self.data, self.compression, most)


_CHANNELS = 2**16
MOST_TOPICS = 4096
"""Largest number of topics in a file, more than any robot has."""

_NONE = -1
_CONTRADICTED = -2


class McapTopics:
    """Schema and channel records read so far.

    Parameters
    ----------
    channels
        Topic of each channel by the file's summary. If the file contradicts the summary, neither
        is trusted, and the channel's messages belong to no known topic.
    report
        Receives descriptions of damage.

    Attributes
    ----------
    names
        Names of the topics read so far.
    types
        Message type of each topic.
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
            self._report.add(f'is damaged: the record of a topic is ignored, {error}')
            return
        if self._claimed.setdefault(number, topic) != topic:
            self._contradict(number, topic)
        elif self._index[number] != _CONTRADICTED:
            self._index[number] = self._place(topic, self._schemas.get(schema, ''))

    def groups(self, channels: NDArray[np.uint16]) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Yield the index in `names` of each topic, negative for none, and its messages.

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

    def name(self, channel: int) -> str | None:
        """Return the topic of a channel, None if unknown."""
        index = int(self._index[channel])
        return None if index < 0 else self.names[index]

    def by_topic(self, counts: dict[int, int]) -> dict[str, int]:
        """Convert a count per channel to a count per topic."""
        found = dict.fromkeys(self.names, 0)
        for channel, count in counts.items():
            topic = self._claimed.get(channel, '')
            found[topic] = found.get(topic, 0) + count
        return found

    def _contradict(self, number: int, topic: str) -> None:
        if self._index[number] != _CONTRADICTED:
            self._report.add(
                f'is damaged: channel {number} has the two names {self._claimed[number][:200]} '
                f'and {topic[:200]}, its messages are ignored'
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
