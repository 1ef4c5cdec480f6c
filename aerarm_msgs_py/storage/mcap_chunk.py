"""One MCAP chunk: what it says of itself, and its records."""

import zlib
from dataclasses import dataclass

from aerarm_msgs_py.storage.decompression import (
    DecompressionError,
    beginning,
    check_claim,
    decompress,
)
from aerarm_msgs_py.storage.read_limits import ReadBudget
from aerarm_msgs_py.storage.record_fields import RecordFields


class ChunkError(ValueError):
    """A chunk that is damaged."""


@dataclass(frozen=True)
class McapChunk:
    """A chunk record.

    Attributes
    ----------
    compression
        'zstd', 'lz4' or '' for none.
    size
        Bytes of its records, as it claims.
    crc
        Checksum of its records; 0 for none.
    data
        The records, compressed; less than `data_size` bytes if the chunk is cut off.
    data_size
        Bytes of the compressed records.
    """

    compression: str
    size: int
    crc: int
    data: bytes
    data_size: int

    @classmethod
    def read(cls, content: bytes) -> 'McapChunk':
        """Take a record apart.

        Raises
        ------
        ChunkError
            If it ends before its data begins.
        """
        fields = RecordFields(content)
        try:
            fields.take(16)  # first and last time: the messages say them too
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
            If it isn't as large as it says, the data is damaged or the checksum wrong.
        BagError
            If the bag's limits don't allow for it.
        """
        try:
            if len(self.data) < self.data_size:
                raise ChunkError(f'it ends {self.data_size - len(self.data)} bytes too early')
            if self.size > budget.part_bytes:
                raise ChunkError(
                    f'it claims to hold {self.size} bytes, more than the {budget.part_bytes} '
                    'that a chunk may (limits part_bytes and ratio)'
                )
            check_claim(self.data, self.compression, self.size)
            if self.compression:
                budget.spend(self.size)
            records = decompress(self.data, self.compression, self.size)
        except DecompressionError as error:
            raise ChunkError(str(error)) from None
        if self.crc and zlib.crc32(records) != self.crc:
            raise ChunkError('its checksum is wrong')
        return records

    def beginning(self, budget: ReadBudget) -> bytes:
        """Return what can be had of a chunk whose end is missing, possibly nothing."""
        most = min(self.size, budget.part_bytes)
        budget.spend(most if self.compression else 0)
        return beginning(self.data, self.compression, most)
