"""A loop with a fixed period and absolute deadlines."""

from __future__ import annotations

import ctypes
import errno
import os
import time
from collections.abc import Callable
from threading import Event

from aerarm_ros.realtime.timing_statistics import TimingStatistics, TimingSummary, assess_timing

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


_PATIENCE = 5e-3  # [s] some cycles: nobody has to wait for a loop that stands still


class CycleSlack:
    """Lets another thread begin its work where a loop has just ended a cycle.

    Two threads of Python share one interpreter, and a loop that wakes while the other one
    computes gets it back late, at each of its own system calls anew. A piece of work that
    begins with the slack is over, if it is short, before the loop wakes.
    """

    def __init__(self) -> None:
        self._begun = Event()

    def begin(self) -> None:
        """Say that a cycle is over; for the loop, takes 0.1 us if nobody waits."""
        if not self._begun.is_set():
            self._begun.set()

    def wait(self) -> None:
        """Wait for the end of a cycle, 5 ms at most."""
        self._begun.clear()
        self._begun.wait(_PATIENCE)


# How fast the clock follows corrections of the system time: 500 ppm, what NTP slews at most.
_SLEW = 500e-6
# A larger correction is the clock being set, as on a board without a clock of its own that
# has just found a time server: to follow it slowly would take too long.
_STEP_NS = 500_000_000


class SteadyClock:
    """Stamps for a stream whose receivers differentiate and integrate over time.

    The system time is corrected in steps of tens of milliseconds, backwards too, by time
    servers and hypervisors. This clock runs with the monotonic one and is led towards the
    system time by at most 500 ppm. A difference of half a second is followed at once, but only
    while `may_step`: an arm that moves by these stamps would jump, or end its motion.

    Parameters
    ----------
    system, monotonic
        Clocks [ns].

    Attributes
    ----------
    may_step
        Whether a large difference may be followed at once.
    behind
        How far the system time was ahead when the time was last asked for [s].
    """

    def __init__(
        self,
        system: Callable[[], int] = time.time_ns,
        monotonic: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._system, self._monotonic = system, monotonic
        self.may_step = True
        self.behind = 0.0
        self._last = monotonic()
        self._offset = system() - self._last

    def now_ns(self) -> int:
        """Return the time [ns since the epoch]."""
        now = self._monotonic()
        error = self._system() - now - self._offset
        if abs(error) > _STEP_NS and self.may_step:
            step = error
        else:
            most = int((now - self._last) * _SLEW)
            step = min(max(error, -most), most)
        self._offset += step
        self._last = now
        self.behind = 1e-9 * (error - step)
        return now + self._offset


class PeriodicLoop:
    """Calls a function at every multiple of a period.

    Deadlines lie on a grid from the start of `run`, so lateness doesn't add up. A cycle
    whose deadline has passed when the one before it ends is skipped and counted: catching
    up by a burst would send a motor several commands at once.

    Parameters
    ----------
    period
        Time between deadlines [s].

    Attributes
    ----------
    period_ns
        Period [ns].
    cycles
        Cycles run.
    missed
        Cycles skipped.
    lateness
        Wake-up behind deadline.
    execution
        Time the function took.
    interval
        Time from one wake-up to the next; its mean is the period that was really kept.

    Raises
    ------
    ValueError
        If the period isn't between 10 us and 1000 s.
    """

    def __init__(self, period: float) -> None:
        if not 10e-6 <= period <= 1000.0:
            raise ValueError(f'period must lie between 10 us and 1000 s, not {period} s')
        self.period_ns = round(period * 1e9)
        span = max(20 * period, 1e-3)
        resolution = max(1e-6, span / 20_000)
        self.lateness = TimingStatistics(resolution, span)
        self.execution = TimingStatistics(resolution, span)
        self.interval = TimingStatistics(resolution, span)
        self.cycles = 0
        self.missed = 0
        self._stopped = False

    @property
    def is_stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped

    def stop(self) -> None:
        """End the loop, for good, after the present cycle; may be called from anywhere."""
        self._stopped = True

    def run(self, function: Callable[[int, int], None]) -> None:
        """Call `function(now_ns, index)` every period until `stop`.

        The first call is one period from now. What the function raises ends the loop.

        Parameters
        ----------
        function
            Takes the monotonic time of the wake-up [ns] and the number of the deadline,
            0, 1, 2...; a skipped cycle leaves its number out.
        """
        clock = time.monotonic_ns
        period_ns = self.period_ns
        index = 0
        deadline = clock() + period_ns
        previous = None
        while not self._stopped:
            sleep_until(deadline)
            now = clock()
            self.lateness.add(now - deadline)
            if previous is not None:
                self.interval.add(now - previous)
            previous = now
            function(now, index)
            self.cycles += 1
            end = clock()
            self.execution.add(end - now)
            behind = max(0, (end - deadline) // period_ns)
            self.missed += behind
            index += 1 + behind
            deadline += (1 + behind) * period_ns

    def assess(self, interval: TimingSummary, execution: TimingSummary) -> tuple[int, str]:
        """Return a level of `timing_assessment`, and what it is about.

        Parameters
        ----------
        interval, execution
            Summaries of the statistics of these names.
        """
        return assess_timing(self.period_ns * 1e-9, interval, execution)

    def account(self) -> str:
        """Return one line for the log's end."""
        total = self.cycles + self.missed
        share = 100.0 * self.missed / total if total else 0.0
        lateness = self.lateness.summary()
        return (
            f'{self.cycles} cycles, {self.missed} missed ({share:.3f} %), woken '
            f'{lateness.p50 * 1e6:.0f} us late (median), {lateness.p999 * 1e6:.0f} us (99.9 %)'
        )
