"""A node that the page starts and ends."""

from __future__ import annotations

import re
import shutil
import tempfile
import threading
from collections.abc import Mapping
from pathlib import Path

from aerarm_ros.ros.process.node_process import NodeProcess

_WORDS_MAX = 300  # characters of its last line
_LOG_PREFIX = re.compile(r'^\[[A-Z]+\] \[[0-9.]+\] \[[^]]*\]: ')


class ChildProgram:
    """Runs one node at a time, and knows its last words.

    A node that ends lets the bridge hold the arm, if it moved it; when the page ends so do these.

    Parameters
    ----------
    namespace
        For the nodes.

    Attributes
    ----------
    name
        What runs, or ran last; '' before the first.
    """

    def __init__(self, namespace: str) -> None:
        self.name = ''
        self._arguments = ('--ros-args', '-r', f'__ns:={namespace}', '--')
        self._logs: Path | None = None
        self._process: NodeProcess | None = None
        self._is_ending = False
        self._starting = threading.Lock()  # clicks are served by several threads

    @property
    def runs(self) -> bool:
        """Whether the node runs."""
        return self._process is not None and self._process.returncode is None

    @property
    def is_ending(self) -> bool:
        """Whether it was asked to end, and has not."""
        return self._is_ending and self.runs

    def start(self, name: str, parameters: Mapping[str, object]) -> None:
        """Start a node; raises RuntimeError if one runs."""
        with self._starting:
            if self.runs:
                raise RuntimeError(f'{self.name} runs already: stop it first')
            if self._logs is None:  # not before: a page that cannot be served leaves nothing
                self._logs = Path(tempfile.mkdtemp(prefix='aerarm_view_'))
            log = self._logs / f'{name}.log'
            self.name, self._is_ending = name, False
            self._process = NodeProcess(name, self._arguments, parameters, log=log)

    def end(self) -> None:
        """Ask the node to end, as Ctrl-C does."""
        if self._process is not None and self.runs:
            self._is_ending = True
            self._process.ask_to_end()

    def last_words(self) -> str:
        """Return the last line that the node printed, with its status if it failed."""
        if self._process is None:
            return ''
        lines = [line for line in self._process.tail(5).splitlines() if line.strip()]
        # Progress is written over itself.
        words = _LOG_PREFIX.sub('', lines[-1].rsplit('\r', 1)[-1].strip()) if lines else ''
        words = words[:_WORDS_MAX]
        status = self._process.returncode
        return f'{words} (ended with {status})' if status not in (None, 0, 130) else words

    def close(self) -> None:
        """End the node, wait for it, and forget what it said."""
        if self._process is not None:
            self._process.stop()
        if self._logs is not None:
            shutil.rmtree(self._logs, ignore_errors=True)
