"""Readers of bags in which rosbag2 compressed each file or each message."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import lz4.frame
import numpy as np
import zstandard

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.storage.read_limits import BagError, DamageReport, MessageBlock, ReadBudget

_PIECE = 2**17  # bytes
_LARGEST_WINDOW = 2**27  # bytes that a zstd frame may use in addition to its content
_LZ4_RATIO = 255  # bound of the LZ4 format
_UNKNOWN_SIZES = (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR)
_FAILURES = (zstandard.ZstdError, RuntimeError, MemoryError)

COMPRESSIONS = ('', 'lz4', 'zstd')
"""Supported compressions of chunks; '' stands for an uncompressed chunk."""


class DecompressionError(ValueError):
    """Compressed data is damaged, or its content does not have the declared size."""


def check_claim(data: bytes, compression: str, size: int) -> None:
    """Check before decompression whether the declared size of the content is possible.

    Raises
    ------
    DecompressionError
        If the compression is unknown or the size is impossible.
    """
    if compression not in COMPRESSIONS:
        raise DecompressionError(f'unknown compression {compression[:20]!r}')
    possible = True
    if not compression:
        possible = len(data) == size
    elif compression == 'lz4':
        possible = size <= _LZ4_RATIO * len(data)
    else:
        content = content_size(data)
        possible = content is None or content == size
    if not possible:
        raise DecompressionError(
            f'the compressed data have {len(data)} bytes, so the stated content size of {size} '
            'bytes is impossible'
        )


def content_size(data: bytes) -> int | None:
    """Return the content size that a zstd frame declares; None if it declares no size.

    Raises
    ------
    DecompressionError
        If the data is not a zstd frame.
    """
    try:
        size = int(zstandard.get_frame_parameters(data).content_size)
    except _FAILURES as error:
        raise DecompressionError(str(error)) from None
    return None if size in _UNKNOWN_SIZES else size


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Decompress data, and check that the result has the declared size of `size` bytes.

    Raises
    ------
    DecompressionError
        If the data is damaged, or its content has another size.
    """
    check_claim(data, compression, size)
    if not compression or not size:
        records = b'' if not size else data
    else:
        try:
            if compression == 'zstd':
                decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
                records = decompressor.decompress(data, max_output_size=size)
            else:
                records = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        except _FAILURES as error:
            raise DecompressionError(str(error)) from None
    if len(records) != size:
        raise DecompressionError(
            f'the decompressed data have {len(records)} bytes instead of the stated {size} bytes'
        )
    return bytes(records)


def beginning(data: bytes, compression: str, most: int) -> bytes:
    """Decompress the start of truncated or damaged data, up to the damage or `most` bytes."""
    if not compression:
        return data[:most]
    parts: list[bytes] = []
    pieces = _zstd_pieces(data) if compression == 'zstd' else _lz4_pieces(data)
    try:
        for piece in pieces if compression in COMPRESSIONS else ():
            parts.append(piece[:most])
            most -= len(parts[-1])
            if not most:
                break
    except _FAILURES:
        pass  # The part before the damage is valid.
    return b''.join(parts)


def _zstd_pieces(data: bytes) -> Iterator[bytes]:
    decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
    with decompressor.stream_reader(data) as reader:
        while piece := reader.read(_PIECE):
            yield piece


def _lz4_pieces(data: bytes) -> Iterator[bytes]:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    given = 0
    while not decompressor.eof and (given < len(data) or not decompressor.needs_input):
        more = b''
        if decompressor.needs_input:
            more = data[given : given + _PIECE]
            given += len(more)
        if piece := decompressor.decompress(more, max_length=_PIECE):
            yield piece


SUFFIX = '.zstd'
"""Suffix that rosbag2 appends to the names of files compressed as a whole."""

_COPIED_PIECE = 2**20  # bytes


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

    types: dict[str, str]
    counts: dict[str, int] | None

    def __init__(self, path: Path, budget: ReadBudget) -> None:
        self.path = path
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
        self.types, self.counts = {}, None
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
        decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
        with (
            self.path.open('rb') as stream,
            decompressor.stream_reader(stream) as reader,
            file.open('wb') as decompressed_file,
        ):
            while piece := reader.read(_COPIED_PIECE):
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
        try:
            size = content_size(payload)
            if size is None or size > budget.part_bytes:
                continue
            budget.spend(size)
            messages.append(decompress(payload, 'zstd', size))
            sound[k] = True
        except DecompressionError:
            continue
    if len(messages) < len(sound):
        report.add(
            f'the reader ignores {len(sound) - len(messages)} messages of topic {block.topic}, '
            'because their compressed data are damaged'
        )
    if not messages:
        return None
    return replace(block.chosen(sound), payloads=Payloads.of(messages))
