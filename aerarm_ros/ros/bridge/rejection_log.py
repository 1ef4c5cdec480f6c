"""Why commands are not followed, for who looks at the bridge's console."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import inf

from rclpy.node import Node

from aerarm_ros.hardware.gate.command_intake import REJECTIONS, CommandIntake
from aerarm_ros.ros.executors.steady_timer import create_steady_timer

# Two publishers have been looked up by then, so that they can be named [s].
_PATIENCE = 0.5
# Rejections begin anew after this long without one of the same reason [s].
_QUIET = 1.0
# Between two lines of the same reason [s].
_PERIOD = 10.0
# Controllers hear of a new mode some commands later, a person reads of it at once [s].
_ON_THE_WAY = 1.0
# Reasons that lie in who publishes.
_OF_PUBLISHERS = ('source', 'not_allowed')


class RejectionLog:
    """Logs a warning when rejections of a reason begin, one line in 10 s for each reason.

    The cycle only notes it, as for `ModeLog`.

    Parameters
    ----------
    node
        Whose log it is.
    publishers_warning
        Returns what is wrong with the publishers of commands, '' if nothing is.
    """

    def __init__(self, node: Node, publishers_warning: Callable[[], str]) -> None:
        self._logger = node.get_logger()
        self._publishers_warning = publishers_warning
        self._heard: dict[str, float] = {}
        self._told: dict[str, float] = {}
        self._mode = ''
        self._mode_since = -inf
        self._noted: deque[str] = deque()
        self._news = node.create_guard_condition(self._wait)
        self._patience = create_steady_timer(node, _PATIENCE, self._write, autostart=False)

    def update(self, intake: CommandIntake, mode: str, now: float) -> None:
        """Note the rejection of the cycle at `now` [s], if there was one; in the cycle's thread."""
        if mode != self._mode:
            self._mode, self._mode_since = mode, now
        if intake.last_rejection_time != now:
            return
        reason = intake.last_rejection
        if reason == 'not_ready' and now - self._mode_since < _ON_THE_WAY:
            return
        silence = now - self._heard.get(reason, -inf)
        self._heard[reason] = now
        if silence < _QUIET or now - self._told.get(reason, -inf) < _PERIOD:
            return
        self._told[reason] = now
        self._noted.append(reason)
        self._news.trigger()

    def _wait(self) -> None:
        self._patience.reset()

    def _write(self) -> None:
        self._patience.cancel()
        while self._noted:
            reason = self._noted.popleft()
            why = self._publishers_warning() if reason in _OF_PUBLISHERS else ''
            self._logger.warning(f'a command was rejected: {why or REJECTIONS[reason]}')
