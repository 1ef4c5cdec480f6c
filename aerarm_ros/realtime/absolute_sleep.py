"""Sleeping to a point in time instead of for a while."""

import ctypes
import errno
import os
import time

_TIMER_ABSTIME = 1
_NANOSECONDS = 1_000_000_000


class _Timespec(ctypes.Structure):
    _fields_ = (('tv_sec', ctypes.c_long), ('tv_nsec', ctypes.c_long))


_clock_nanosleep = getattr(ctypes.CDLL(None), 'clock_nanosleep', None)


def sleep_until(deadline_ns: int) -> None:
    """Sleep until the monotonic clock reaches `deadline_ns` [ns].

    A relative sleep is late by whatever happens between reading the clock and falling
    asleep; this one isn't. Signal handlers run during the sleep, and what they raise
    (KeyboardInterrupt) comes out of here.

    Parameters
    ----------
    deadline_ns
        Time of `time.monotonic_ns` [ns]; a past time returns at once.

    Raises
    ------
    OSError
        If the system refuses the call.
    """
    if _clock_nanosleep is None:  # not Linux
        time.sleep(max(0, deadline_ns - time.monotonic_ns()) / _NANOSECONDS)
        return
    until = ctypes.byref(_Timespec(*divmod(deadline_ns, _NANOSECONDS)))
    # An interrupted sleep comes back here, so that Python runs its signal handlers.
    while (error := _clock_nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, until, None)) != 0:
        if error != errno.EINTR:
            raise OSError(error, f'clock_nanosleep: {os.strerror(error)}')
