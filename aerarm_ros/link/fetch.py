"""Transfer of files from the drone to the ground, in blocks, over an unreliable radio link.

The ground requests numbered blocks, and repeats the request for blocks that do not arrive. The
drone only answers requests. After an interruption or a restart of either end, the ground keeps the
stored blocks and requests the next ones. It requests fewer blocks while datagrams are delayed, so
that commands and states do not wait in the radio's queue.
"""

from __future__ import annotations

import errno
import json
import os
import re
import struct
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

BLOCK = 1024
"""Size of a block, the unit of a file transfer [bytes]."""
ASKED_MAX = 32
"""Largest number of blocks per request."""
_MARKER = '.fetch'  # file with the manifest of an incomplete bag
PARTIAL = '.part'
"""Suffix of the name of an incomplete file."""

_HEAD = struct.Struct('<HHI')  # manifest, file, block
_QUESTION = struct.Struct('<HB')  # manifest, number of blocks
_PLACE = struct.Struct('<HI')  # file, block
_AHEAD = 1_000_000  # bytes that the disk reads at once
_SPAN = 512  # most blocks in transit
_AGAIN = 0.25  # [s] beyond the round trip, after which a block is requested again
_FILES_MAX, _SIZE_MAX = 1 << 16, BLOCK << 32  # limits of file and block numbers
_DELAY_MAX = 0.05  # [s] of a queue in the radio
_CALM = 0.2  # [s] between two reductions
_NAME = re.compile(r'[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}')


def is_name(text: str) -> bool:
    """Return whether a text is a permitted name of a bag or file, not a path or hidden file."""
    return _NAME.fullmatch(text) is not None


def questions(content: bytes) -> tuple[int, list[bytes]]:
    """Decode a request for blocks into the manifest's number and the packed block numbers.

    Raises struct.error if the request is truncated.
    """
    number, count = _QUESTION.unpack_from(content)
    places = content[_QUESTION.size :][: count * _PLACE.size]
    return number, [places[k : k + _PLACE.size] for k in range(0, len(places), _PLACE.size)]


class FileServer:
    """Reads requested blocks of the files in one folder.

    Parameters
    ----------
    folder
        Folder of the files.
    number
        Number of this list of files (manifest), 0 to 65535.

    Attributes
    ----------
    manifest
        Name and size [bytes] of each file.
    """

    def __init__(self, folder: Path, number: int) -> None:
        self._number = number
        paths = (path for path in folder.iterdir() if is_name(path.name) and path.is_file())
        self._paths = sorted(paths)[:_FILES_MAX]
        self.manifest = [[path.name, path.stat().st_size] for path in self._paths]
        self._open: tuple[int, BinaryIO] | None = None

    def answer(self, place: bytes) -> bytes:
        """Return the answer that contains the block at `place`, a packed file and block number.

        Raises
        ------
        struct.error
            If `place` has another length.
        IndexError
            If the file number is unknown.
        BlockingIOError
            If the block is not in the page cache. The system now loads it, so try again later. An
            e-stop must not wait for a busy disk.
        OSError
            If the file cannot be read.
        """
        file, block = _PLACE.unpack(place)
        if self._open is None or self._open[0] != file:
            self.close()
            self._open = file, self._paths[file].open('rb')
        left = int(str(self.manifest[file][1])) - block * BLOCK  # the file may have grown
        content = _cached(self._open[1].fileno(), max(0, min(BLOCK, left)), block * BLOCK)
        return _HEAD.pack(self._number, file, block) + content

    def close(self) -> None:
        """Close the file that the last read block belongs to."""
        if self._open is not None:
            self._open[1].close()
            self._open = None


def _cached(file: int, size: int, offset: int) -> bytes:
    """Read bytes of a file; raise BlockingIOError if the page cache does not contain them."""
    content = bytearray(size)
    try:
        count = os.preadv(file, [content], offset, os.RWF_NOWAIT)
        if count < size and offset + count < os.fstat(file).st_size:
            raise BlockingIOError(errno.EAGAIN, 'the page cache contains only a part of the block')
    except BlockingIOError:
        os.posix_fadvise(file, offset, _AHEAD, os.POSIX_FADV_WILLNEED)
        raise
    except OSError as error:
        if error.errno != errno.EOPNOTSUPP:
            raise
        return os.pread(file, size, offset)  # this file system does not support RWF_NOWAIT
    return bytes(content[:count])


class Fetch:
    """Fetches the files of a list (manifest) into a folder, in order and block by block.

    Parameters
    ----------
    folder
        Folder for the files, which may already contain some of them.
    number, manifest
        Number and manifest of the `FileServer`.
    rate
        Largest number of blocks per second.

    Attributes
    ----------
    size, stored
        Total and stored bytes of all files.

    Raises
    ------
    ValueError
        If the manifest is invalid, or the folder contains another recording.
    OSError
        If the folder cannot be written.
    """

    def __init__(self, folder: Path, number: int, manifest: object, rate: float) -> None:
        self._files = _files_of(manifest)
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._number = number
        self._rate = rate
        self.size = sum(size for _, size in self._files)
        self.stored = 0
        self._pace = min(50.0, rate)  # blocks per second
        self._credit, self._asked_at, self._reduced = 0.0, float('nan'), float('-inf')
        self._came: deque[bool] = deque(maxlen=100)
        self._file = -1
        self._stream: BinaryIO | None = None
        # A disk can take seconds to store a file, and must not block the connection.
        self._worker = ThreadPoolExecutor(1)
        self._storing: Future[None] | None = None
        self._claim(folder)
        self._next_file()

    @property
    def is_complete(self) -> bool:
        """Whether all files of the manifest are stored."""
        return self._file >= len(self._files)

    @property
    def is_storing(self) -> bool:
        """Whether a received file is still being stored, before the next file can begin."""
        return self._storing is not None

    def question(self, now: float, delay: float, round_trip: float) -> bytes | None:
        """Return the next block request, None if no request is due.

        Raises OSError if a file cannot be stored.

        Parameters
        ----------
        now
            Monotonic time [s].
        delay
            Delay of the newest datagram minus the shortest delay of the last minute [s].
        round_trip
            Round-trip time of the connection [s].
        """
        if self._storing is not None and self._storing.done():
            self._rename()
        if self.is_complete or self._storing is not None:
            return None
        self._adapt(now, delay)
        patience = _AGAIN + 1.5 * (round_trip if round_trip == round_trip else 0.1)
        places: list[int] = []
        for block in range(self._block, min(self._block + _SPAN, self._blocks)):
            if self._credit < 1.0 or len(places) >= ASKED_MAX:
                break
            asked = self._asked.get(block)
            if block in self._waiting or (asked is not None and now - asked < patience):
                continue
            if asked is not None:
                self._came.append(False)
            self._asked[block] = now
            self._credit -= 1.0
            places.append(block)
        if not places:
            return None
        head = _QUESTION.pack(self._number, len(places))
        return head + b''.join(_PLACE.pack(self._file, block) for block in places)

    def take(self, answer: bytes) -> None:
        """Store a received block.

        Raises OSError if the disk is full, and struct.error if the block is truncated.
        """
        if self.is_complete or self._stream is None:
            return
        number, file, block = _HEAD.unpack_from(answer)
        content = answer[_HEAD.size :]
        ahead = block - self._block
        if number != self._number or file != self._file or not 0 <= ahead < _SPAN:
            return
        if len(content) != min(BLOCK, self._files[file][1] - block * BLOCK):
            return
        self._came.append(True)
        self._waiting[block] = content
        while self._block in self._waiting:
            content = self._waiting.pop(self._block)
            self._stream.write(content)
            self._asked.pop(self._block, None)
            self._block += 1
            self.stored += len(content)
        if self._block >= self._blocks:
            self._store()

    def close(self) -> None:
        """Close the incomplete file."""
        self._worker.shutdown(wait=False)
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _adapt(self, now: float, delay: float) -> None:
        elapsed = min(0.1, now - self._asked_at) if self._asked_at == self._asked_at else 0.02
        self._asked_at = now
        is_lossy = len(self._came) == self._came.maxlen and sum(self._came) < 50
        if (delay > _DELAY_MAX or is_lossy) and now - self._reduced > _CALM:
            self._reduced = now
            self._pace = max(2.0, 0.7 * self._pace)
            self._came.clear()
        elif delay <= _DELAY_MAX:
            self._pace = min(self._rate, self._pace + 100.0 * elapsed)
        self._credit = min(self._credit + elapsed * self._pace, 0.1 * self._pace + 1.0)

    def _claim(self, folder: Path) -> None:
        """Store the manifest in the folder; raise ValueError if the folder has another bag."""
        self._marker = folder / _MARKER
        paths = {folder / name: size for name, size in self._files}
        if all(path.is_file() and path.stat().st_size == size for path, size in paths.items()):
            return
        text = json.dumps(self._files)
        if self._marker.exists() and self._marker.read_text() == text:
            return
        for path in paths:
            if path.exists():
                raise ValueError(f'{path} belongs to another recording: choose another name')
            path.with_name(path.name + PARTIAL).unlink(missing_ok=True)
        self._marker.write_text(text)

    def _next_file(self) -> None:
        """Open the next incomplete file."""
        self._waiting: dict[int, bytes] = {}
        self._asked: dict[int, float] = {}
        self._block = self._blocks = 0
        while True:
            self._file += 1
            if self.is_complete:
                self._marker.unlink(missing_ok=True)
                return
            name, size = self._files[self._file]
            path = self._folder / name
            if path.exists() and path.stat().st_size == size:
                self.stored += size
                continue
            partial = self._folder / (name + PARTIAL)
            have = partial.stat().st_size if partial.exists() else 0
            self._block = min(have, size) // BLOCK
            self._blocks = -(-size // BLOCK)
            self.stored += self._block * BLOCK
            self._stream = partial.open('r+b' if have else 'wb')
            self._stream.truncate(self._block * BLOCK)
            self._stream.seek(self._block * BLOCK)
            if self._block >= self._blocks:
                self._store()
            return

    def _store(self) -> None:
        """Start to flush the received file to the disk, in a worker thread."""
        assert self._stream is not None
        self._storing = self._worker.submit(_stored, self._stream)
        self._stream = None

    def _rename(self) -> None:
        """Give the stored file its final name, and open the next file."""
        storing, self._storing = self._storing, None
        assert storing is not None
        storing.result()
        name = self._files[self._file][0]
        (self._folder / (name + PARTIAL)).replace(self._folder / name)
        self._next_file()


def _stored(stream: BinaryIO) -> None:
    with stream:
        stream.flush()
        os.fsync(stream.fileno())


def _files_of(manifest: object) -> list[tuple[str, int]]:
    """Return name and size [bytes] of each file; raise ValueError for an invalid manifest."""
    try:
        files = [(str(name), int(size)) for name, size in manifest]  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        files = []
    is_valid = all(is_name(name) and 0 <= size <= _SIZE_MAX for name, size in files)
    if not is_valid or not 0 < len(dict(files)) == len(files) <= _FILES_MAX:
        raise ValueError(
            f'the drone sent an invalid list of files, {str(manifest)[:200]}: install the same '
            'version of aerarm_ros on both hosts'
        )
    return files
