"""Ends a process whose libraries do not.

Fast DDS takes leave of the others when a node is destroyed or, where something still holds it, in
an exit handler of the C library. There it may spin without an end (docs/decisions.md, 70). Python
is gone by then or waits in C, and with it every signal handler and thread of Python; so the C
library keeps the limit.
"""

import ctypes
import os
import time
from contextlib import suppress

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

    def __enter__(self) -> 'ExitLimit':
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
