"""What the arm does, and why it stopped, for who looks at the bridge's console."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from rclpy.node import Node

# Boards that are there answer well before [s].
_PATIENCE = 1.0
_RECOVERY = "mend the cause, then 'arm clear_fault', and 'arm enable' if the motors are off"


class ModeLog:
    """Logs every new mode, a fault with its reason and the way out.

    The cycle only notes it: a line of log costs up to a millisecond, which the executor's
    thread has. That the boards do not answer is said if it lasts: every start begins so.

    Parameters
    ----------
    node
        Whose log it is.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._noted: deque[tuple[str, Sequence[str]]] = deque()
        self._news = node.create_guard_condition(self._write)
        self._text = ''
        self._patience = node.create_timer(_PATIENCE, self._write_disconnected, autostart=False)

    def note(self, mode: str, reasons: Sequence[str] = ()) -> None:
        """Note a new mode and why the arm is in it; called from the cycle's thread."""
        self._noted.append((mode, reasons))
        self._news.trigger()

    def _write(self) -> None:
        log = self._node.get_logger()
        while self._noted:
            mode, reasons = self._noted.popleft()
            self._text = f'{mode}: {"; ".join(reasons)}' if reasons else mode
            self._patience.cancel()
            # rclpy ties a severity to the line that logs.
            if mode == 'disconnected':
                self._patience.reset()
            elif mode == 'fault':
                log.error(f'{self._text}. To recover: {_RECOVERY}')
            else:
                log.info(self._text)

    def _write_disconnected(self) -> None:
        self._patience.cancel()
        self._node.get_logger().warning(self._text)
