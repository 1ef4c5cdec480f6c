"""A loop with a fixed period and absolute deadlines."""

import time
from collections.abc import Callable

from aerarm_ros.realtime.absolute_sleep import sleep_until
from aerarm_ros.realtime.timing_assessment import assess_timing
from aerarm_ros.realtime.timing_statistics import TimingStatistics
from aerarm_ros.realtime.timing_summary import TimingSummary


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
