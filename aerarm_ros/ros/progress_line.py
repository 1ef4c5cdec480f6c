"""A progress bar on a terminal, drawn at most ten times per second."""

from __future__ import annotations

import sys
from typing import TextIO

_INTERVAL_NS = 100_000_000  # [ns] between two updates on a terminal


class ProgressLine:
    """Update one line on a terminal; in other streams, write one line per phase.

    Parameters
    ----------
    name : name of the program, at the front of each line.
    stream : output stream; standard output by default.
    """

    def __init__(self, name: str, stream: TextIO | None = None) -> None:
        self._name = name
        self._stream = sys.stdout if stream is None else stream
        self._terminal = self._stream.isatty()
        self._phase: str | None = None
        self._due_ns = 0
        self._width = 0

    def due(self, now_ns: int, phase: str = '') -> bool:
        """Return whether a line in this phase is due at `now_ns` [ns, any clock]."""
        if phase == self._phase and not (self._terminal and now_ns >= self._due_ns):
            return False
        self._phase = phase
        self._due_ns = now_ns + _INTERVAL_NS
        return True

    def show(self, text: str) -> None:
        """Replace the last line by `text`."""
        line = f'{self._name}: {text}'
        if self._terminal:
            self._stream.write('\r' + line.ljust(self._width))
            self._width = len(line)
        else:
            self._stream.write(line + '\n')
        self._stream.flush()

    def close(self) -> None:
        """End the line on the terminal."""
        if self._terminal and self._width:
            self._stream.write('\n')
            self._stream.flush()
            self._width = 0
