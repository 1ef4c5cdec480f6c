"""Bags that rosbag2 compressed as a whole, or message by message."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

import numpy as np
import zstandard

from aerarm_msgs_py.codecs.payloads import Payloads
from aerarm_msgs_py.storage.bag_error import BagError
from aerarm_msgs_py.storage.damage_report import DamageReport
from aerarm_msgs_py.storage.decompression import DecompressionError, content_size, decompress
from aerarm_msgs_py.storage.message_block import MessageBlock
from aerarm_msgs_py.storage.read_limits import ReadBudget

SUFFIX = '.zstd'
"""What rosbag2 adds to the names of files compressed as a whole."""

_PIECE = 2**20  # bytes
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
                raise BagError(f'{self.path} cannot be decompressed: {error}') from error
            self._inner = self._opened(file, self._budget)
            yield from self._inner.blocks(topics)

    def _decompress(self, file: Path) -> None:
        decompressor = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
        with (
            self.path.open('rb') as stream,
            decompressor.stream_reader(stream) as reader,
            file.open('wb') as decompressed_file,
        ):
            while piece := reader.read(_PIECE):
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
            f'is damaged: {len(sound) - len(messages)} messages of {block.topic} are left out, '
            'as they cannot be decompressed'
        )
    if not messages:
        return None
    return replace(block.chosen(sound), payloads=Payloads.of(messages))
