"""What the arm does, and why it stopped, for who looks at the bridge's console."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from math import inf

from rclpy.node import Node

from aerarm_ros.ros.diagnostics.sentences import followed_by
from aerarm_ros.ros.executors.steady_timer import create_steady_timer

# Boards that are there answer well before [s]; what goes to and fro faster is told once in it.
_PATIENCE = 1.0
# Modes between which an arm can go to and fro, as under a controller that is nearly too slow.
_TO_AND_FRO = ('running', 'damping')
# Modes that say nothing without their reason. Why commands are rejected has a log of its own.
_WITH_REASON = ('disconnected', 'unhomed', 'damping', 'fault')
_SINKS = 'The arm sinks until a good command comes'


class ModeLog:
    """Logs every new mode, a fault with its reason and the way out, an arm that sinks as a warning.

    The cycle only notes it: a line of log costs up to a millisecond, which the executor's
    thread has. That the boards do not answer is said if it lasts: every start begins so.

    Parameters
    ----------
    node
        Whose log it is.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._noted: deque[tuple[str, Sequence[str], str]] = deque()
        self._news = node.create_guard_condition(self._write)
        self._mode = self._text = self._way_out = ''
        self._told: dict[str, float] = {}
        self._patience = create_steady_timer(
            node, _PATIENCE, self._write_patiently, autostart=False
        )

    def note(self, mode: str, reasons: Sequence[str] = (), way_out: str = '') -> None:
        """Note a new mode, why the arm is in it, the way out; called from the cycle's thread."""
        self._noted.append((mode, reasons, way_out))
        self._news.trigger()

    def _write(self) -> None:
        while self._noted:
            self._mode, reasons, self._way_out = self._noted.popleft()
            has_reason = self._mode in _WITH_REASON and reasons
            self._text = f'{self._mode}: {"; ".join(reasons)}' if has_reason else self._mode
            self._patience.cancel()
            if self._mode == 'disconnected' or self._is_to_and_fro():
                self._patience.reset()
            else:
                self._say()

    def _is_to_and_fro(self) -> bool:
        since = time.monotonic() - self._told.get(self._mode, -inf)
        return self._mode in _TO_AND_FRO and since < _PATIENCE

    def _write_patiently(self) -> None:
        self._patience.cancel()
        self._say()

    def _say(self) -> None:
        self._told[self._mode] = time.monotonic()
        log = self._node.get_logger()
        # rclpy ties a severity to the line that logs.
        if self._mode == 'fault':
            log.error(followed_by(self._text, f'To recover: {self._way_out}'))
        elif self._mode == 'damping':
            log.warning(followed_by(self._text, _SINKS))
        elif self._mode in _WITH_REASON:
            log.warning(self._text)
        else:
            log.info(self._text)
