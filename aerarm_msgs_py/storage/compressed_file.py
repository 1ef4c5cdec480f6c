"""Readers of bags in which rosbag2 compressed each file or each message."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import lz4.frame
import numpy as np
import zstandard

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.storage.read_limits import BagError, DamageReport, MessageBlock, ReadBudget

_PIECE = 2**20  # bytes
_LARGEST_WINDOW = 2**27  # bytes that a zstd frame may use in addition to its content
_FAILURES = (zstandard.ZstdError, RuntimeError, MemoryError)


def decompress(data: bytes, compression: str, most: int) -> bytes:
    """Decompress data up to their end, their first damage, or `most` bytes.

    Parameters
    ----------
    compression
        'zstd', 'lz4', or '' for no compression.

    Raises
    ------
    ValueError
        If the compression is unknown.
    """
    if not compression:
        return data[:most]
    if compression not in ('lz4', 'zstd'):
        raise ValueError(f'unknown compression {compression[:20]!r}')
    pieces = _zstd_pieces(data, most) if compression == 'zstd' else _lz4_pieces(data, most)
    parts: list[bytes] = []
    with suppress(*_FAILURES):  # the part before the damage is valid
        parts.extend(pieces)
    return b''.join(parts)


def _zstd_reader(source: object) -> zstandard.ZstdDecompressionReader:
    return zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW).stream_reader(source)  # type: ignore[arg-type]


def _zstd_pieces(data: bytes, most: int) -> Iterator[bytes]:
    with _zstd_reader(data) as reader:
        while piece := reader.read(min(_PIECE, most)):
            most -= len(piece)
            yield piece


def _lz4_pieces(data: bytes, most: int) -> Iterator[bytes]:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    while most and not decompressor.eof and (data or not decompressor.needs_input):
        more = b''
        if decompressor.needs_input:
            more, data = data[:_PIECE], data[_PIECE:]
        piece = decompressor.decompress(more, max_length=min(_PIECE, most))
        most -= len(piece)
        yield piece


SUFFIX = '.zstd'
"""Suffix that rosbag2 appends to the names of files compressed as a whole."""


class BagFile(ABC):
    """Base class of the readers of bag files.

    Parameters
    ----------
    path
        Path of the file.
    budget
        Limits for reading.

    Attributes
    ----------
    types
        Message type of every topic found so far.
    counts
        Number of messages per topic that the file states; None if unknown.
    """

    def __init__(self, path: Path, budget: ReadBudget) -> None:
        self.path = path
        self.types: dict[str, str] = {}
        self.counts: dict[str, int] | None = None
        self._budget = budget
        self._report = DamageReport(path)

    @property
    def damaged(self) -> bool:
        """Whether the reader has found damage or a truncated end."""
        return self._report.places > 0

    @abstractmethod
    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of `topics` in blocks; None selects all topics."""


class CompressedFile(BagFile):
    """Reader of one bag file that was compressed as a whole.

    Parameters
    ----------
    path
        Path of the .zstd file.
    budget
        Limits for reading, which include the decompressed temporary file.
    opened
        Function that returns the reader of the decompressed file.
    """

    def __init__(
        self, path: Path, budget: ReadBudget, opened: Callable[[Path, ReadBudget], BagFile]
    ) -> None:
        super().__init__(path, budget)
        self._opened = opened

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of `topics` in blocks; None selects all topics.

        Raises
        ------
        BagError
            If the file cannot be decompressed or read, or exceeds the limits.
        """
        with TemporaryDirectory() as folder:
            file = Path(folder, self.path.name.removesuffix(SUFFIX))
            try:
                self._decompress(file)
            except (OSError, zstandard.ZstdError, MemoryError) as error:
                raise BagError(
                    f'the file {self.path} cannot be decompressed ({error}): copy it again'
                ) from error
            inner = self._opened(file, self._budget)
            try:
                yield from inner.blocks(topics)
            finally:
                self.types, self.counts, self._report = inner.types, inner.counts, inner._report

    def _decompress(self, file: Path) -> None:
        with (
            self.path.open('rb') as stream,
            _zstd_reader(stream) as reader,
            file.open('wb') as decompressed_file,
        ):
            while piece := reader.read(_PIECE):
                self._budget.spend(len(piece))
                decompressed_file.write(piece)


def decompressed(
    block: MessageBlock, report: DamageReport, budget: ReadBudget
) -> MessageBlock | None:
    """Decompress a block whose messages are compressed one by one.

    Damaged messages are left out and reported. The result is None if all messages are damaged.

    Raises
    ------
    BagError
        If the messages would exceed the limits.
    """
    messages = []
    sound = np.zeros(len(block.payloads), bool)
    for k, payload in enumerate(block.payloads):
        with suppress(zstandard.ZstdError):
            size = zstandard.get_frame_parameters(payload).content_size
            if size > budget.part_bytes:  # also an unknown size, which is a large number
                continue
            budget.spend(size)
            content = decompress(payload, 'zstd', size)
            if len(content) == size:
                messages.append(content)
                sound[k] = True
    if len(messages) < len(sound):
        report.add(
            f'the reader ignores {len(sound) - len(messages)} messages of topic {block.topic}, '
            'because their compressed data are damaged'
        )
    if not messages:
        return None
    return replace(block.chosen(sound), payloads=Payloads.of(messages))
