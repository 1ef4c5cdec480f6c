"""SIGINT and SIGTERM as a request instead of an exception.

A node that drives motors must finish its cycle and leave the boards safe. With rclpy's own
handlers the context dies first and publishing fails; with Python's, KeyboardInterrupt comes
out of the middle of an exchange.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from types import FrameType

_STOP = (signal.SIGINT, signal.SIGTERM)


class StopSignals:
    """Context in which the stop signals call a function; the second of them ends the process.

    Parameters
    ----------
    on_stop
        Called once, in the main thread, between two of its instructions: it should set a
        flag and return.
    """

    def __init__(self, on_stop: Callable[[], None]) -> None:
        self._on_stop = on_stop
        self._previous: dict[signal.Signals, object] = {}

    def __enter__(self) -> StopSignals:
        self._previous = {number: signal.signal(number, self._handle) for number in _STOP}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _handle(self, number: int, frame: FrameType | None) -> None:
        for other in _STOP:
            signal.signal(other, signal.SIG_DFL)
        self._on_stop()
