"""SIGINT, SIGTERM and SIGHUP as a request instead of an exception.

A node that drives motors must finish its cycle and leave the boards safe. With rclpy's own
handlers the context dies first and publishing fails; with Python's, KeyboardInterrupt comes
out of the middle of an exchange; and SIGHUP, which comes when the terminal is closed or ssh
loses its connection, would end the process on the spot.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from types import FrameType

# Asked for by a person or a supervisor: when they ask again, they mean it.
_ASKED = (signal.SIGINT, signal.SIGTERM)
# A terminal and a supervisor may both pass on the same Ctrl-C [s]: what comes so soon is no second
# thought, and the boards are being told to switch off.
_SAME = 1.0


class StopSignals:
    """Context in which the stop signals call a function.

    A second SIGINT or SIGTERM, a second or more after the first, ends the process. SIGHUP never
    does: a closing terminal sends it more than once. Where it is ignored already, as under
    nohup, it stays so.

    Parameters
    ----------
    on_stop
        Called once, in the main thread, between two of its instructions: it should set a
        flag and return.
    """

    def __init__(self, on_stop: Callable[[], None]) -> None:
        self._on_stop = on_stop
        self._is_stopping = False
        self._asked: float | None = None
        self._previous: dict[signal.Signals, object] = {}

    def __enter__(self) -> StopSignals:
        is_kept = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        numbers = _ASKED if is_kept else (*_ASKED, signal.SIGHUP)
        self._previous = {number: signal.signal(number, self._handle) for number in numbers}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if number in _ASKED:
            now = time.monotonic()
            if self._asked is None:
                self._asked = now
            elif now - self._asked > _SAME:
                signal.signal(number, signal.SIG_DFL)
                signal.raise_signal(number)
        if not self._is_stopping:
            self._is_stopping = True
            self._on_stop()
