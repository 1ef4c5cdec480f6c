"""The file that keeps the encoders' zeros while no bridge runs."""

from __future__ import annotations

import threading
import time
from math import inf
from pathlib import Path

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.resources import write_whole
from aerarm_ros.hardware.boards.kept_zeros import (
    LONGEST,
    HostClock,
    KeptZeros,
    KeptZerosError,
    arm_identity,
)
from aerarm_ros.hardware.bridge_cycle import BridgeCycle

_PERIOD = 1.0  # [s]
_BOOT_ID = Path('/proc/sys/kernel/random/boot_id')


def host_clock() -> HostClock:
    """Return whose monotonic clock this process reads; raises OSError where no kernel says it."""
    boot = _BOOT_ID.read_text(encoding='ascii').strip()
    suspended = time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()
    return HostClock(boot, suspended)


def _text(path: Path) -> str:
    """Return what a file holds; one that is no file is not opened: it might never end."""
    if path.exists() and not path.is_file():
        raise KeptZerosError('is no regular file')
    with path.open(encoding='utf-8') as file:
        return file.read(LONGEST + 1)


class ZeroFile:
    """Writes the known zeros once per second, and at once when one is found or lost.

    The cycle's thread makes the text in its slack, another one writes it: no disk delays a cycle.
    The file is not forced to the disk, because it is void once the host has started again.

    Parameters
    ----------
    path
        The file; its folder is made. None keeps nothing.
    config
        The arm.

    Attributes
    ----------
    problem
        Why the file cannot be written, or ''.
    """

    def __init__(self, path: Path | None, config: ArmConfig) -> None:
        self.problem = ''
        self._path = path
        self._config = config
        self._arm = arm_identity(config)
        self._host: HostClock | None = None
        self._due = -inf
        self._changes = -1
        self._text = ''
        self._news = threading.Event()
        self._ends = False
        self._thread: threading.Thread | None = None

    def read(self, now: float) -> KeptZeros | str | None:
        """Return the zeros that were kept, why they cannot be used, or None if there is no file.

        Parameters
        ----------
        now
            Time [s, monotonic].
        """
        if self._path is None:
            return None
        try:
            self._host = host_clock()
            return KeptZeros.parse(_text(self._path)).check(self._arm, self._host, now)
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError, KeptZerosError) as error:
            reason = getattr(error, 'strerror', None) or error
            if isinstance(error, UnicodeDecodeError):
                reason = 'is no text'
            return f'the state file {self._path} cannot be used: it {reason}'

    def update(self, cycle: BridgeCycle, now: float) -> None:
        """Write what the cycle knows if that is due at `now` [s] or has changed."""
        if self._host is None or (now < self._due and cycle.zeros.changes == self._changes):
            return
        kept = cycle.recall.keep(self._arm, self._host)
        if kept is None:
            return
        self._due, self._changes = now + _PERIOD, cycle.zeros.changes
        self._text = kept.text()
        self._news.set()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name='zero_file', daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Write what is left to write; the next update begins again."""
        if self._thread is not None:
            self._ends = True
            self._news.set()
            self._thread.join()
            self._thread, self._ends = None, False

    def _run(self) -> None:
        while not self._ends or self._news.is_set():
            self._news.wait()
            self._news.clear()
            if self._path is not None and self._text:
                self._write(self._path, self._text)

    def _write(self, path: Path, text: str) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, text, durable=False)
            self.problem = ''
        except OSError as error:
            self.problem = (
                f'the state file {path} cannot be written ({error.strerror}): after a '
                'restart of the bridge the arm has to be homed'
            )
