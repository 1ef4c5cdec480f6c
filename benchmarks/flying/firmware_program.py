"""An autopilot's firmware as a program on this host."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Self

_ENDING = 5.0  # [s]
# Ends the program together with the process that starts it, because PX4 runs on without its
# simulator. The guard is a separate process, since code between fork and exec may hang with
# threads.
_GUARD = """
import ctypes, os, signal, sys
parent = int(sys.argv[1])
ctypes.CDLL(None).prctl(1, signal.SIGKILL, 0, 0, 0)
if os.getppid() == parent:
    os.execv(sys.argv[2], sys.argv[2:])
"""


class FirmwareProgram:
    """Context manager that runs a program, and ends it also after `kill -9` of this process.

    Parameters
    ----------
    folder : Path
        Working folder of the program.
    log : str
        Name of the log file in this folder.

    Attributes
    ----------
    log : Path
        Log file of the program's output.
    """

    def __init__(self, folder: Path, log: str) -> None:
        self.folder, self.log = folder, folder / log
        self._process: subprocess.Popen[bytes] | None = None

    def command(self) -> tuple[list[str], dict[str, str]]:
        """Return command line and environment."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        self.start()
        return self

    def start(self) -> None:
        """Start the program."""
        command, environment = self.command()
        guard = [sys.executable, '-c', _GUARD, str(os.getpid())]
        with self.log.open('ab') as log:
            self._process = subprocess.Popen(
                [*guard, *command], cwd=self.folder, stdin=subprocess.DEVNULL, stdout=log,
                stderr=log, env=environment, start_new_session=True,
            )  # fmt: skip

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def is_running(self) -> bool:
        """Whether the program has been started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def end(self) -> None:
        """End the program if it runs."""
        if self._process is None or not self.is_running:
            return
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    @property
    def pid(self) -> int:
        """Process id of the program."""
        assert self._process is not None
        return self._process.pid
