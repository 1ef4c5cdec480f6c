"""Bags that rosbag2 compressed as a whole, or message by message."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import lz4.frame
import numpy as np
import zstandard

from aerarm_msgs_py.codecs.cdr import Payloads
from aerarm_msgs_py.storage.read_limits import BagError, DamageReport, MessageBlock, ReadBudget

_PIECE = 2**17  # bytes
_LARGEST_WINDOW = 2**27  # bytes that a zstd frame may ask for beside its content
_LZ4_RATIO = 255  # the format's own bound
_UNKNOWN_SIZES = (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR)
_FAILURES = (zstandard.ZstdError, RuntimeError, MemoryError)

COMPRESSIONS = ('', 'lz4', 'zstd')
"""What chunks may be compressed with; '' is none."""


class DecompressionError(ValueError):
    """Data that is damaged, or is not as large as it claims."""


def check_claim(data: bytes, compression: str, size: int) -> None:
    """Require that data can become as large as it claims to, before anything is decompressed.

    Raises
    ------
    DecompressionError
        If the compression isn't known or the data can't be that large.
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
        raise DecompressionError(f'the stated size of {size} bytes is impossible')


def content_size(data: bytes) -> int | None:
    """Return how large a zstd frame says its content is, None if it doesn't say.

    Raises
    ------
    DecompressionError
        If it isn't a zstd frame.
    """
    try:
        size = int(zstandard.get_frame_parameters(data).content_size)
    except _FAILURES as error:
        raise DecompressionError(str(error)) from None
    return None if size in _UNKNOWN_SIZES else size


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Return data that claims to hold `size` bytes, and stop there.

    Raises
    ------
    DecompressionError
        If it is damaged or holds more or less.
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
        raise DecompressionError(f'{len(records)} bytes after decompression instead of {size}')
    return bytes(records)


def beginning(data: bytes, compression: str, most: int) -> bytes:
    """Return what can be had of data whose end is missing or damaged, at most some bytes."""
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
        pass  # what came before is sound
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
"""What rosbag2 adds to the names of files compressed as a whole."""

_COPIED_PIECE = 2**20  # bytes
_LARGEST_WINDOW = 2**27  # bytes


class BagFile(Protocol):
    """A file of messages."""

    @property
    def types(self) -> dict[str, str]:
        """Message type of every topic met while reading."""

    @property
    def damaged(self) -> bool:
        """Whether reading met a missing end or damage."""

    @property
    def counts(self) -> dict[str, int] | None:
        """Messages of every topic by the file's own account, None without one."""

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics."""


class CompressedFile:
    """Reader of one file that was compressed as a whole; same use as `McapFile`.

    Parameters
    ----------
    path
        The .zstd file.
    budget
        What reading may take; the decompressed file, which is written to a temporary folder,
        counts too.
    opened
        Returns the reader of the decompressed file.
    """

    def __init__(
        self, path: Path, budget: ReadBudget, opened: Callable[[Path, ReadBudget], BagFile]
    ) -> None:
        self.path = path
        self._budget = budget
        self._opened = opened
        self._inner: BagFile | None = None
        self._name = path.name.removesuffix(SUFFIX)

    @property
    def types(self) -> dict[str, str]:
        """Message type of every topic met while reading."""
        return self._inner.types if self._inner else {}

    @property
    def damaged(self) -> bool:
        """Whether reading met a missing end or damage."""
        return bool(self._inner and self._inner.damaged)

    @property
    def counts(self) -> dict[str, int] | None:
        """Messages of every topic by the file's own account, None without one."""
        return self._inner.counts if self._inner else None

    def blocks(self, topics: Collection[str] | None = None) -> Iterator[MessageBlock]:
        """Yield the messages of some topics (None: of all).

        Raises
        ------
        BagError
            If the file can't be decompressed or read, or would become larger than allowed.
        """
        with TemporaryDirectory() as folder:
            file = Path(folder, self._name)
            try:
                self._decompress(file)
            except (OSError, zstandard.ZstdError, MemoryError) as error:
                raise BagError(
                    f'{self.path} cannot be decompressed ({error}): copy the file again'
                ) from error
            self._inner = self._opened(file, self._budget)
            yield from self._inner.blocks(topics)

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
    """Return a block whose messages were each compressed by themselves.

    Damaged ones are left out and reported; None if all of them are.

    Raises
    ------
    BagError
        If the messages would become larger than allowed.
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
        report.tell(
            f'is damaged: {len(sound) - len(messages)} messages of {block.topic} cannot be '
            'decompressed and are ignored'
        )
    if not messages:
        return None
    return replace(block.chosen(sound), payloads=Payloads.of(messages))
