"""What an MCAP file says of itself at its end."""

import zlib
from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.opcode import Opcode

from aerarm_msgs_py.storage.mcap_messages import RECORD
from aerarm_msgs_py.storage.record_fields import RecordFields

MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of a file."""
FOOTER_SIZE = 20
"""Bytes of the content of the footer record."""


@dataclass
class McapSummary:
    """The summary of a file; empty if there is none, or it is damaged.

    Attributes
    ----------
    channels
        Topic of each channel.
    counts
        Messages of each channel; None without an account.
    chunks
        Where chunks begin, in order.
    """

    channels: dict[int, str] = field(default_factory=dict)
    counts: dict[int, int] | None = None
    chunks: list[int] = field(default_factory=list)


def read_summary(stream: BinaryIO, size: int, most: int) -> McapSummary:
    """Read the summary of a file, wherever the stream is.

    Parameters
    ----------
    stream
        The file.
    size
        Its bytes.
    most
        Bytes that a summary may have; a larger one is not read.
    """
    end = size - RECORD.size - FOOTER_SIZE - len(MAGIC)
    if end < len(MAGIC):
        return McapSummary()
    stream.seek(end)
    footer = stream.read(RECORD.size + FOOTER_SIZE)
    fields = RecordFields(footer[RECORD.size :])
    start, _, crc = fields.number(8), fields.number(8), fields.number(4)
    is_footer = RECORD.unpack_from(footer) == (Opcode.FOOTER, FOOTER_SIZE)
    if not is_footer or stream.read() != MAGIC or not len(MAGIC) < start < end <= start + most:
        return McapSummary()
    stream.seek(start)
    content = stream.read(end - start)
    # The checksum covers the footer up to itself.
    if crc and zlib.crc32(content + footer[:-4]) != crc:
        return McapSummary()
    try:
        return _summary(content)
    except ValueError:
        return McapSummary()


def _summary(content: bytes) -> McapSummary:
    summary = McapSummary()
    records = RecordFields(content)
    while records.left:
        opcode, length = records.number(1), records.number(8)
        fields = RecordFields(records.take(length))
        if opcode == Opcode.CHANNEL:
            number, _ = fields.number(2), fields.number(2)
            summary.channels[number] = fields.text()
        elif opcode == Opcode.CHUNK_INDEX:
            fields.take(16)  # first and last time
            summary.chunks.append(fields.number(8))
        elif opcode == Opcode.STATISTICS:
            summary.counts = read_counts(fields)
    summary.chunks.sort()
    return summary


def read_counts(fields: RecordFields) -> dict[int, int]:
    """Return the messages of each channel by the content of a statistics record.

    Raises
    ------
    ValueError
        If it is damaged.
    """
    fields.take(42)  # counts of other things, first and last time
    entries = RecordFields(fields.take(fields.number(4)))
    counts = {}
    while entries.left:
        channel = entries.number(2)
        counts[channel] = entries.number(8)
    return counts
