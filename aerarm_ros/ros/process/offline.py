"""Programs that read and write files, and need no running ROS."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from aerarm_ros.ros.process.process_end import INTERRUPTED

_AGAIN = 1.0  # [s] longer than the removal of unfinished files takes


def run_offline(name: str, run: Callable[[], int]) -> int:
    """Run a program until it ends or is interrupted; return its exit status.

    Parameters
    ----------
    name : str
        Program name, for messages.
    run : callable
        Function to run. An interrupt raises KeyboardInterrupt in it, even if the shell had made
        interrupts ignored.
    """
    interrupt = _Interrupt()
    # A shell that starts this program in the background makes SIGINT ignored, so set it too.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM):
        signal.signal(number, interrupt)
    try:
        return run()
    except KeyboardInterrupt:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        print(f'{name}: interrupted, no files were written', file=sys.stderr)
        return INTERRUPTED


def without_ros_arguments(arguments: Sequence[str] | None) -> list[str]:
    """Return the arguments without those that a launch file appends for ROS."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    while '--ros-args' in given:
        start = given.index('--ros-args')
        end = given.index('--', start) + 1 if '--' in given[start:] else len(given)
        del given[start:end]
    return given


class _Interrupt:
    """Signal handler that raises KeyboardInterrupt once, even for several signals."""

    def __init__(self) -> None:
        self._is_asked = False

    def __call__(self, number: int, frame: Any) -> None:
        if self._is_asked and number != signal.SIGALRM:
            return  # the program is removing unfinished files
        self._is_asked = True
        # An exception inside a callback of an extension module or a destructor is lost. So a timer
        # raises it again, unless the program has ended by then.
        signal.setitimer(signal.ITIMER_REAL, _AGAIN)
        raise KeyboardInterrupt
