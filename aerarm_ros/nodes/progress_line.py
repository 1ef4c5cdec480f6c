"""Progress of a long run on a terminal or in a log."""

from __future__ import annotations

import sys
from typing import TextIO


class ProgressLine:
    """Rewrites one line on a terminal; writes a line a second elsewhere.

    Parameters
    ----------
    name : what runs, at the front of each line.
    stream : where to; standard output by default.
    """

    def __init__(self, name: str, stream: TextIO | None = None) -> None:
        self._name = name
        self._stream = sys.stdout if stream is None else stream
        self._terminal = self._stream.isatty()
        self._interval_ns = 100_000_000 if self._terminal else 1_000_000_000
        self._due_ns: int | None = None
        self._width = 0

    def due(self, now_ns: int) -> bool:
        """Return whether a new line is worth composing at `now_ns` [ns], any clock."""
        if self._due_ns is not None and now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + self._interval_ns
        return True

    def show(self, text: str) -> None:
        """Show `text` in place of the line before."""
        line = f'{self._name}: {text}'
        if self._terminal:
            self._stream.write('\r' + line.ljust(self._width))
            self._width = len(line)
        else:
            self._stream.write(line + '\n')
        self._stream.flush()

    def close(self) -> None:
        """End the line that was being rewritten."""
        if self._terminal and self._width:
            self._stream.write('\n')
            self._stream.flush()
            self._width = 0
