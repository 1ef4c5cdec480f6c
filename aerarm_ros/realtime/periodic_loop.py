"""Periodic loop with absolute deadlines, its clock, and statistics of its timing."""

from __future__ import annotations

import ctypes
import errno
import math
import os
import time
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from itertools import repeat
from threading import Event

import numpy as np
from numpy.typing import NDArray

_TIMER_ABSTIME = 1
_NANOSECONDS = 1_000_000_000


class _Timespec(ctypes.Structure):
    _fields_ = (('tv_sec', ctypes.c_long), ('tv_nsec', ctypes.c_long))


_clock_nanosleep = ctypes.CDLL(None).clock_nanosleep


def sleep_until(deadline_ns: int) -> None:
    """Sleep until the monotonic clock reaches `deadline_ns` [ns].

    A relative sleep is late by the time between reading the clock and falling asleep; this absolute
    sleep is not. Signal handlers run during the sleep; an exception in them (KeyboardInterrupt)
    ends the sleep.

    Parameters
    ----------
    deadline_ns
        Time of `time.monotonic_ns` [ns]; a past time returns at once.

    Raises
    ------
    OSError
        If the system call fails.
    """
    until = ctypes.byref(_Timespec(*divmod(deadline_ns, _NANOSECONDS)))
    # An interrupted sleep returns here, so that Python runs its signal handlers.
    while (error := _clock_nanosleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, until, None)) != 0:
        if error != errno.EINTR:
            raise OSError(error, f'clock_nanosleep: {os.strerror(error)}')


_PATIENCE = 5e-3  # [s], a few cycles: a thread need not wait for a stopped loop


class CycleSlack:
    """Lets another thread begin its work at the end of a loop's cycle.

    Two Python threads use one interpreter. A loop that wakes while the other thread computes waits
    for the interpreter after each system call. A short piece of work that starts at the end of a
    cycle ends before the loop wakes.
    """

    def __init__(self) -> None:
        self._begun = Event()

    def begin(self) -> None:
        """Wake the waiting thread, as a cycle has ended; takes 0.1 us if no thread waits."""
        if not self._begun.is_set():
            self._begun.set()

    def wait(self) -> None:
        """Wait for the end of the loop's present cycle, for at most 5 ms."""
        self._begun.clear()
        self._begun.wait(_PATIENCE)


# Fastest correction toward the system time: 500 ppm, the limit of NTP (decision 9).
_SLEW = 500e-6
# A larger correction means that the clock was set, as on a board without battery clock that has
# just found a time server. Following it slowly would take too long.
_STEP_NS = 500_000_000


class SteadyClock:
    """Clock for message stamps, which follows the system time but never steps.

    Time servers and hypervisors correct the system time in steps of tens of milliseconds, even
    backwards. A SteadyClock follows the monotonic clock and approaches the system time by at most
    500 ppm. A difference of half a second is corrected at once, but only while `may_step`, because
    an arm that moves by these stamps would jump.

    Parameters
    ----------
    system, monotonic
        Clocks [ns].

    Attributes
    ----------
    may_step
        Whether a large difference to the system time may be corrected at once.
    behind
        System time minus this clock's time at the last call [s].
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
        """Return the clock's time [ns since the Unix epoch]."""
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


OK, WARN, ERROR = 0, 1, 2


# Limits for a warning and for an error, as in ros2_control: deviation of the mean rate [Hz], mean
# and standard deviation of the execution time [s].
_RATE_ERROR, _EXECUTION_MEAN, _EXECUTION_STD = (5.0, 10.0), (1e-3, 2e-3), (100e-6, 200e-6)


class PeriodicLoop:
    """Calls a function once per period, at absolute deadlines.

    Deadlines lie on a grid from the start of `run`, so lateness does not accumulate. A cycle whose
    deadline passes during the previous cycle is skipped and counted, because catching up would
    send several commands to a motor at once.

    Parameters
    ----------
    period
        Time between deadlines [s].

    Attributes
    ----------
    period_ns
        Period [ns].
    cycles
        Number of cycles run.
    missed
        Number of cycles skipped.
    lateness
        Wake-up time minus deadline.
    execution
        Duration of the function.
    interval
        Time between two wake-ups of the loop; the mean is the actual period.

    Raises
    ------
    ValueError
        If the period is not between 10 us and 1000 s.
    """

    def __init__(self, period: float) -> None:
        if not 10e-6 <= period <= 1000.0:
            raise ValueError(f'period {period} s must lie between 10 us and 1000 s')
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
        """End the loop after the present cycle; any thread or signal handler may call this."""
        self._stopped = True

    def run(self, function: Callable[[int, int], None]) -> None:
        """Call `function(now_ns, index)` every period until `stop`.

        The first call is one period from now. An exception of the function ends the loop.

        Parameters
        ----------
        function
            Receives the monotonic time of the wake-up [ns] and the number of the deadline, 0, 1,
            2...; a skipped cycle leaves its number out.
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
        """Return the level (OK, WARN or ERROR) of this loop's timing, and the reason.

        Parameters
        ----------
        interval, execution
            Summaries of the loop's statistics `interval` and `execution`.
        """
        if not interval.count:
            return OK, 'no cycle yet'
        rate, mean, std = 1.0 / interval.mean, execution.mean, execution.std
        checks = (
            (abs(rate - 1e9 / self.period_ns), _RATE_ERROR, f'rate is {rate:.1f} Hz'),
            (
                mean,
                _EXECUTION_MEAN,
                f'the execution of a cycle takes {mean * 1e6:.0f} us on average',
            ),
            (
                std,
                _EXECUTION_STD,
                f'execution times of cycles have a standard deviation of {std * 1e6:.0f} us',
            ),
        )
        levels = [
            (int(value > warn) + (value > error), text) for value, (warn, error), text in checks
        ]
        worst = max(level for level, _ in levels)
        if worst == OK:
            return OK, f'{rate:.1f} Hz, {mean * 1e6:.0f} us per cycle'
        return worst, '; '.join(text for level, text in levels if level == worst)

    def account(self) -> str:
        """Return a log line with the numbers of cycles and missed cycles, and the latency."""
        total = self.cycles + self.missed
        share = 100.0 * self.missed / total if total else 0.0
        lateness = self.lateness.summary()
        return (
            f'{self.cycles} cycles, {self.missed} missed ({share:.3f} %), wake-up latency '
            f'{lateness.p50 * 1e6:.0f} us (median), {lateness.p999 * 1e6:.0f} us (p99.9)'
        )


@dataclass(frozen=True)
class TimingSummary:
    """Statistics of measured durations [s]; all values are zero without measurements.

    Attributes
    ----------
    count
        Number of durations.
    mean, std
        Mean and standard deviation [s].
    minimum, p50, p99, p999, maximum
        Smallest, median, p99 and p99.9, largest [s].
    """

    count: int = 0
    mean: float = 0.0
    std: float = 0.0
    minimum: float = 0.0
    p50: float = 0.0
    p99: float = 0.0
    p999: float = 0.0
    maximum: float = 0.0


class TimingStatistics:
    """Collects durations in a histogram, in about 0.3 us per duration.

    Mean, standard deviation (Welford's recursion), minimum and maximum are exact; quantiles are
    exact to one bin. Of durations beyond the last bin, only their number and maximum are known.

    Parameters
    ----------
    resolution
        Width of a bin [s].
    span
        Largest duration with its own bin [s].

    Raises
    ------
    ValueError
        If resolution is not positive or span is not larger than resolution.
    """

    def __init__(self, resolution: float = 1e-6, span: float = 20e-3) -> None:
        if not 1e-9 <= resolution < span < math.inf:
            raise ValueError(
                f'resolution {resolution} and span {span} [s] must satisfy 1 ns <= '
                'resolution < span'
            )
        self._width = round(resolution * _NANOSECONDS)
        self._last = math.ceil(span / resolution)
        self._bins = array('Q', repeat(0, self._last + 1))
        self._count = 0
        self._mean = 0.0
        self._squares = 0.0
        self._minimum = 0
        self._maximum = 0

    @property
    def count(self) -> int:
        """Number of durations."""
        return self._count

    def add(self, duration_ns: int) -> None:
        """Add a duration [ns]."""
        count = self._count = self._count + 1
        deviation = duration_ns - self._mean
        self._mean += deviation / count
        self._squares += deviation * (duration_ns - self._mean)
        if duration_ns > self._maximum or count == 1:
            self._maximum = duration_ns
        if duration_ns < self._minimum or count == 1:
            self._minimum = duration_ns
        index = duration_ns // self._width
        if index < 0:
            index = 0
        elif index > self._last:
            index = self._last
        self._bins[index] += 1

    def summary(self) -> TimingSummary:
        """Return the statistics of all durations added so far, in seconds."""
        count = self._count
        if not count:
            return TimingSummary()
        cumulative = np.cumsum(np.array(self._bins, dtype=np.int64))
        return TimingSummary(
            count=count,
            mean=self._mean / _NANOSECONDS,
            std=math.sqrt(max(self._squares, 0.0) / count) / _NANOSECONDS,
            minimum=self._minimum / _NANOSECONDS,
            p50=self._quantile(cumulative, 0.5),
            p99=self._quantile(cumulative, 0.99),
            p999=self._quantile(cumulative, 0.999),
            maximum=self._maximum / _NANOSECONDS,
        )

    def _quantile(self, cumulative: NDArray[np.int64], share: float) -> float:
        """Return a quantile [s]: the upper edge of its bin, between minimum and maximum."""
        index = int(np.searchsorted(cumulative, math.ceil(share * cumulative[-1])))
        edge = self._maximum if index == self._last else (index + 1) * self._width
        return min(max(edge, self._minimum), self._maximum) / _NANOSECONDS
