"""The end of a process: exit status, signals and time limits.

Fast DDS takes leave of the others when a node is destroyed or, where something still holds it, in
an exit handler of the C library. There it may spin without an end (docs/decisions.md, 70). Python
is gone by then or waits in C, and with it every signal handler and thread of Python; so the C
library keeps the limit.

A node that drives motors must finish its cycle and leave the boards safe. With rclpy's own
handlers the context dies first and publishing fails; with Python's, KeyboardInterrupt comes
out of the middle of an exchange; and SIGHUP, which comes when the terminal is closed or ssh
loses its connection, would end the process on the spot, as would SIGQUIT, SIGXCPU (the limit of a
real-time process) and a dozen more. What cannot be caught is SIGKILL, and what the processor says
of an instruction (SIGSEGV, SIGBUS, SIGFPE, SIGILL): Python's handlers run after that instruction,
which is never over. Nor can abort() be kept from ending the process.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from types import FrameType
from typing import ClassVar, TextIO

USER_ERROR = 2  # what was asked for cannot be done as asked
INTERRUPTED = 130  # ended by Ctrl-C, as shells say it


def print_error(name: str, error: object) -> None:
    """Print an error on one line of standard error, after the name of the executable."""
    _print(f'{name}: {" ".join(str(error).split())}', sys.stderr)


def print_notice(name: str, notice: str) -> None:
    """Print progress on standard error; a closed stream does not end the program."""
    _print(f'{name}: {notice}', sys.stderr)


def print_answer(answer: str) -> None:
    """Print a result on standard output; a closed stream does not end the program."""
    _print(answer, sys.stdout)


def print_account(name: str, account: str) -> None:
    """Print the last words of an executable, if its terminal is still there."""
    _print(f'{name}: {account}', sys.stdout)


def _print(text: str, stream: TextIO) -> None:
    try:
        print(text, file=stream, flush=True)
    except OSError:
        # The terminal is closed. Python tries once more when it ends, and would end with 120.
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


# Processor time [s] for taking leave, which needs tenths: what is stopped or starved has no less.
LIMIT = 10.0
_SIGEV_THREAD = 2  # <bits/sigevent-consts.h>: a thread of the C library calls a function


class _Value(ctypes.Union):
    _fields_ = (('number', ctypes.c_int), ('pointer', ctypes.c_void_p))


class _Event(ctypes.Structure):
    """`struct sigevent` of <bits/types/sigevent_t.h>, as long as it is there."""

    _fields_ = (
        ('value', _Value),
        ('signal', ctypes.c_int),
        ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p),
        ('attributes', ctypes.c_void_p),
        ('padding', ctypes.c_char * 32),
    )


class _Times(ctypes.Structure):
    """`struct itimerspec` of <bits/types/struct_itimerspec.h>."""

    _fields_ = tuple((name, ctypes.c_long) for name in ('every', 'every_ns', 'first', 'first_ns'))


class ExitLimit:
    """Context that ends this process by `_exit` if it takes too much of the processor.

    The thread goes on without real-time priority: at that of a loop it would let nobody on its
    processor interrupt it. Where the system knows no such timer there is no limit.

    Parameters
    ----------
    status
        Exit status of an end by the limit.
    limit
        Processor time of all threads from entering on [s], above 0.
    """

    def __init__(self, status: int, limit: float = LIMIT) -> None:
        self._status = status
        self._limit = limit
        self._c = ctypes.CDLL(None)
        self._timer: ctypes.c_void_p | None = None

    def __enter__(self) -> ExitLimit:
        if os.sched_getscheduler(0) in (os.SCHED_FIFO, os.SCHED_RR):
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        if not hasattr(self._c, 'timer_create'):  # glibc before 2.34
            return self
        exit_now = ctypes.cast(self._c._exit, ctypes.c_void_p).value
        event = _Event(_Value(number=self._status), notify=_SIGEV_THREAD, function=exit_now)
        timer = ctypes.c_void_p()
        made = self._c.timer_create(
            time.CLOCK_PROCESS_CPUTIME_ID, ctypes.byref(event), ctypes.byref(timer)
        )
        if made == 0:
            seconds = int(self._limit)
            times = _Times(first=seconds, first_ns=int((self._limit - seconds) * 1e9))
            self._c.timer_settime(timer, 0, ctypes.byref(times), None)
            self._timer = timer
        return self

    def __exit__(self, *_: object) -> None:
        if self._timer is not None:
            self._c.timer_delete(self._timer)


def exit_within(status: int, limit: float = LIMIT) -> None:
    """End this process by `_exit` if it takes more than `limit` [s] of the processor to end.

    For the last that Python does; `status` is the exit status also then.
    """
    ExitLimit(status, limit).__enter__()


# Asked for by a person or a supervisor: when they ask again, they mean it.
_ASKED = (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT)
# What else ends a process, where nobody has a use for it.
_ENDING: tuple[int, ...] = tuple(
    signal.Signals[name]
    for name in (
        'SIGHUP',
        'SIGABRT',
        'SIGALRM',
        'SIGVTALRM',
        'SIGPROF',
        'SIGUSR1',
        'SIGUSR2',
        'SIGXCPU',
        'SIGIO',
        'SIGPWR',
        'SIGSTKFLT',
        'SIGSYS',
        'SIGTRAP',
    )
    if name in signal.Signals.__members__  # others than Linux have not all of them
)
_ENDING += tuple(range(signal.SIGRTMIN, signal.SIGRTMAX + 1))
# What holds a process up until somebody lets it go on: Ctrl-Z, and a terminal of another's.
_FREEZING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
# A terminal and a supervisor may both pass on the same Ctrl-C [s]: what comes so soon is no second
# thought, and the boards are being told to switch off.
_SAME = 1.0


@dataclass
class _Request:
    """What was asked so far, for all contexts that lie within each other."""

    is_made: bool = False
    asked: float | None = None  # when first by one of _ASKED [s, monotonic]


class StopSignals:
    """Context in which the stop signals call a function.

    A second SIGINT, SIGTERM or SIGQUIT, a second or more after the first, ends the process. SIGHUP
    never does: a closing terminal sends it more than once. Where it is ignored already, as under
    nohup, it stays so; so are the other signals left alone where they have a use.

    A context may lie within another. What the inner one was asked counts as asked of the outer:
    while a process ends, the same signal again calls nothing.

    Parameters
    ----------
    on_stop
        Called once, in the main thread, between two of its instructions: it should set a
        flag and return. Called at once if the outer context was asked already.
    stays_awake
        True for a process that Ctrl-Z shall not stop: its boards would let the arm fall.
    is_last
        True where nothing is left to do after the context: it leaves the signals as `ignore` does,
        so that a late one finds no moment at which it ends the process.
    """

    _innermost: ClassVar[StopSignals | None] = None

    def __init__(
        self, on_stop: Callable[[], None], stays_awake: bool = False, is_last: bool = False
    ) -> None:
        self._on_stop = on_stop
        self._stays_awake = stays_awake
        self._is_last = is_last
        self._is_told = False
        self._request = _Request()
        self._outer: StopSignals | None = None
        self._previous: dict[int, object] = {}

    def __enter__(self) -> StopSignals:
        self._outer = StopSignals._innermost
        StopSignals._innermost = self
        if self._outer is not None:
            self._request = self._outer._request
        unused = [number for number in _ENDING if self._may_take(number)]
        self._previous = {
            number: signal.signal(number, self._handle) for number in (*_ASKED, *unused)
        }
        if self._stays_awake:
            self._previous |= {n: signal.signal(n, signal.SIG_IGN) for n in _FREEZING}
        if self._request.is_made and not self._is_told:
            self._tell()
        return self

    def __exit__(self, *_: object) -> None:
        StopSignals._innermost = self._outer
        if self._is_last:
            self.ignore()
            return
        for number, handler in self._previous.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    @staticmethod
    def ignore() -> None:
        """Let the signals do nothing any more: everything is done, and Python only takes leave.

        It would give its own handlers up on the way, and a late signal end the process as if that
        had failed.
        """
        for number in (*_ASKED, *_ENDING):
            signal.signal(number, signal.SIG_IGN)

    def _may_take(self, number: int) -> bool:
        """Whether a signal means nothing but an end, here or in the outer context."""
        handler = signal.getsignal(number)
        if number == signal.SIGHUP:
            return handler is not signal.SIG_IGN
        outer = self._outer
        return handler is signal.SIG_DFL or (outer is not None and number in outer._previous)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        request = self._request
        if number in _ASKED:
            now = time.monotonic()
            if request.asked is None:
                request.asked = now
            elif now - request.asked > _SAME:
                signal.signal(number, signal.SIG_DFL)
                signal.raise_signal(number)
        if not request.is_made:
            request.is_made = True
            self._tell()

    def _tell(self) -> None:
        self._is_told = True
        self._on_stop()
