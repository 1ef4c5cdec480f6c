"""Prevent Fast DDS from blocking the bridge's cycle when another process starts.

The first message to another process opens its shared-memory port. If the port was checked just
before, the sender sleeps for `port_wait_timeout_ms` of that port (Fast DDS 2.14,
`SharedMemGlobal.hpp`). This wait is a third of `healthy_check_timeout_ms`: 1 s with the packaged
profile and 0.33 s with the default one. A sender in the 1 kHz loop must not sleep. A short health
check would drop the messages of a process that pauses, and Fast DDS has no setting for the wait
alone. So `PortWatch` shortens the wait in each new port, which its owner also uses as the period of
its idle loop.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import select
import struct
import threading
from pathlib import Path

WAIT_MS = 10
"""Wait time that `PortWatch` writes to `port_wait_timeout_ms` of each Fast DDS port [ms]."""

_FOLDER = Path('/dev/shm')
_NAME = re.compile(r'fastrtps_port(\d+)')
_FIELDS = struct.Struct('<IIII')  # port, listeners, health check, wait
_CHECK_MS = range(30, 600_001)
_IN_CREATE, _IN_MOVED_TO = 0x100, 0x80
_EVENT = struct.Struct('iIII')
_TRIES, _PAUSE = 40, 0.002  # the owner fills the file after it has created it
_POLL = 0.2  # [s]


def shorten_wait(path: Path) -> bool:
    """Shorten the wait time in a Fast DDS port's file; return False if the file is incomplete.

    A file with another layout stays unchanged.

    Raises
    ------
    OSError
        If the file cannot be opened, for example because another user owns it.
    """
    found = _NAME.fullmatch(path.name)
    if found is None:
        return False
    port = struct.pack('<I', int(found[1]))
    # Not mapped: a file that its owner shortens would end the bridge with SIGBUS.
    with path.open('r+b', buffering=0) as stream:
        content = stream.read()
        place = content.find(port)
        while 0 <= place <= len(content) - _FIELDS.size:
            _, _, check, wait = _FIELDS.unpack_from(content, place)
            if check in _CHECK_MS and wait in (check // 3, WAIT_MS):
                os.pwrite(stream.fileno(), struct.pack('<I', min(wait, WAIT_MS)), place + 12)
                return True
            place = content.find(port, place + 1)
    return False


class PortWatch:
    """Context in which a thread shortens the wait times of new Fast DDS ports on this host.

    Parameters
    ----------
    folder
        Folder of the shared-memory files.
    """

    def __init__(self, folder: Path = _FOLDER) -> None:
        self._folder = folder
        self._is_over = threading.Event()
        self._thread: threading.Thread | None = None
        self._events = -1

    def __enter__(self) -> PortWatch:
        library = ctypes.CDLL(None, use_errno=True)
        self._events = library.inotify_init1(os.O_NONBLOCK | os.O_CLOEXEC)
        mask = _IN_CREATE | _IN_MOVED_TO
        if (
            self._events < 0
            or library.inotify_add_watch(self._events, os.fsencode(self._folder), mask) < 0
        ):
            return self
        self._thread = threading.Thread(target=self._work, name='port_watch', daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        if self._thread is not None:
            self._thread.join()
        if self._events >= 0:
            os.close(self._events)

    def _work(self) -> None:
        for path in self._folder.glob('fastrtps_port*'):
            self._shorten(path)
        poll = select.poll()
        poll.register(self._events, select.POLLIN)
        while not self._is_over.is_set():
            if poll.poll(1e3 * _POLL):
                with contextlib.suppress(OSError):
                    for name in _names(os.read(self._events, 65536)):
                        self._shorten(self._folder / name)

    def _shorten(self, path: Path) -> None:
        """Shorten the wait time of a new port, as soon as its owner has written the file."""
        if _NAME.fullmatch(path.name) is None:
            return
        with contextlib.suppress(OSError, ValueError):
            for _ in range(_TRIES):
                if shorten_wait(path) or self._is_over.wait(_PAUSE):
                    return


def _names(events: bytes) -> list[str]:
    """Return the file names in a sequence of inotify events."""
    names, place = [], 0
    while place < len(events):
        *_, length = _EVENT.unpack_from(events, place)
        place += _EVENT.size
        names.append(os.fsdecode(events[place : place + length].rstrip(b'\0')))
        place += length
    return names
