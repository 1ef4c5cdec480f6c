"""Readers of the records of an MCAP file: fields of a record, chunks, topics."""

import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from aerarm_msgs_py.storage.compressed_file import decompress
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


class ChunkContent(NamedTuple):
    """Decompressed records of a chunk, and a number that identifies equal chunks.

    Attributes
    ----------
    records
        Schema, channel and message records.
    digest
        Size and checksum of the records of the complete chunk.
    """

    records: bytes
    digest: tuple[bytes, int, int]


def read_chunk(content: bytes, budget: ReadBudget, *, whole: bool) -> ChunkContent:
    """Decompress a chunk record; only its beginning if the record is truncated.

    Raises
    ------
    ValueError
        If the chunk is damaged, or exceeds the limit `part_bytes`.
    BagError
        If the records exceed the remaining limits of the bag.
    """
    fields = RecordFields(content)
    times = fields.take(16)  # of the first and the last message
    size, crc = fields.number(8), fields.number(4)
    compression, data_size = fields.text(), fields.number(8)
    data = fields.take(data_size if whole else min(data_size, fields.left))
    if size > budget.part_bytes:
        raise ValueError(
            f'the chunk states a size of {size} bytes, above the limit of {budget.part_bytes} '
            'bytes (see the bag limits part_bytes and ratio)'
        )
    records = decompress(data, compression, size + 1)
    budget.spend(len(records) if compression else 0)
    if not whole:
        return ChunkContent(records, (times, size, crc))
    if len(records) != size:
        raise ValueError(f'its {len(data)} bytes of data do not contain the stated {size} bytes')
    found = zlib.crc32(records)
    if crc and found != crc:
        raise ValueError('the content of the chunk does not match its checksum')
    return ChunkContent(records, (times, size, found))


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
    types
        Message type of each topic found so far, by name.
    """

    def __init__(self, channels: dict[int, str], report: DamageReport) -> None:
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

    def groups(self, channels: NDArray[np.uint16]) -> Iterator[tuple[str, NDArray[np.intp]]]:
        """Yield the name of each topic, '' for unknown topics, and the indices of its messages.

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
        names = list(self._places)
        for place, messages in zip(found.tolist(), np.split(order, firsts[1:]), strict=True):
            yield names[place] if place >= 0 else '', messages

    def by_topic(self, counts: dict[int, int] | None) -> dict[str, int] | None:
        """Convert numbers of messages per channel to numbers of messages per topic."""
        if counts is None:
            return None
        found = dict.fromkeys(self._places, 0)
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
        if topic not in self.types and len(self.types) == MOST_TOPICS:
            raise BagError(
                f'the bag has more than {MOST_TOPICS} topics: check whether it is damaged'
            )
        self.types[topic] = kind
        return self._places.setdefault(topic, len(self._places))
