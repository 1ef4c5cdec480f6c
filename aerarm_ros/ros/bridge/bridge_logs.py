"""Log lines of a bridge: changes of mode and rejected commands."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from math import inf

from rclpy.node import Node

from aerarm_ros.hardware.gate.command_intake import REJECTIONS, CommandIntake
from aerarm_ros.ros.executors import create_steady_timer


def followed_by(text: str, sentence: str) -> str:
    """Return a text and a sentence after it; a text that asks something needs no full stop."""
    end = '' if text.endswith(('.', '?', '!')) else '.'
    return f'{text}{end} {sentence}'


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


# Two publishers have been looked up by then, so that they can be named [s].
_REJECTION_PATIENCE = 0.5
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
        self._patience = create_steady_timer(
            node, _REJECTION_PATIENCE, self._write, autostart=False
        )

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
