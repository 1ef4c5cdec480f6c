"""A loop whose time is that of an emulated world: one period a cycle, however long that took."""

from __future__ import annotations

import time
from collections.abc import Callable

from aerarm_ros.realtime.absolute_sleep import sleep_until
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.realtime.timing_assessment import OK
from aerarm_ros.realtime.timing_summary import TimingSummary

# Below this share of real time the account calls the host too slow for a real arm.
_AS_GOOD_AS_REAL = 0.99
# A bridge damps its arm after a silence of this length [ns]: a smaller total slip is harmless.
_NOTICED_SLIP_NS = 50_000_000


class WorldLoop(PeriodicLoop):
    """Calls a function once a period of world time, at most as fast as real time.

    While the host can, deadlines lie on a grid, as those of a `PeriodicLoop`. A host that is a
    period late or more, because it was busy or asleep, shifts the grid: no cycle is skipped, and
    no time passes in the world meanwhile.

    Parameters
    ----------
    period
        World time from cycle to cycle [s].
    hold
        Called before each cycle; blocks while the world has to wait for somebody, and returns
        whether the cycle may come before its deadline.
    wait_first
        Whether the deadline is waited for before `hold` is called, so that it blocks only where
        the host is too slow; else it is called at once, and a cycle may come early.

    Attributes
    ----------
    period_ns, cycles, lateness, execution, interval
        As of a `PeriodicLoop`, in the host's time; no cycle is ever missed.
    slipped_ns
        Time [ns] that went by on the host and not in the world.
    stood_ns
        Time [ns] that the world stood still because nothing happened in it: for `hold` to add to,
        and left out of the share of real time.

    Raises
    ------
    ValueError
        If the period isn't between 10 us and 1000 s.
    """

    def __init__(
        self,
        period: float,
        hold: Callable[[], bool],
        wait_first: bool = True,
        start_ns: int = 0,
    ) -> None:
        super().__init__(period)
        self.slipped_ns = self.stood_ns = 0
        self._hold = hold
        self._wait_first = wait_first
        self._host_ns = 0
        self._start_ns = start_ns

    @property
    def world_ns(self) -> int:
        """World time [ns]: that of the present cycle, or of the last one."""
        return self._start_ns + self.cycles * self.period_ns

    def run(self, function: Callable[[int, int], None]) -> None:
        """Call `function(world_ns, index)` every period until `stop`.

        Parameters
        ----------
        function
            Takes the world time [ns], a period after the start at the first call, and the number
            of the cycle, 0, 1, 2... What it raises ends the loop.
        """
        clock = time.monotonic_ns
        previous = clock()
        due = previous + self.period_ns
        while True:
            due = self._wait(due)
            if self._stopped:
                return
            now = clock()
            self.interval.add(now - previous)
            self._host_ns += now - previous
            previous = now
            self.cycles += 1
            function(self.world_ns, self.cycles - 1)
            self.execution.add(clock() - now)
            due += self.period_ns

    def _wait(self, due: int) -> int:
        """Wait for the next cycle; return the deadline that it came for."""
        clock = time.monotonic_ns
        if self._wait_first:
            sleep_until(due)
            self.lateness.add(clock() - due)
            self._hold()
        elif self._hold():
            now = clock()
            if now < due:
                return now
        else:
            sleep_until(due)
            self.lateness.add(clock() - due)
        late = clock() - due
        if late < self.period_ns:
            return due
        self.slipped_ns += late
        return due + late

    @property
    def share_of_real_time(self) -> float:
        """World time over the host's, since the start; above one for a world that runs ahead."""
        host_ns = self._host_ns - self.stood_ns
        return self.cycles * self.period_ns / host_ns if host_ns > 0 else 1.0

    def assess(self, interval: TimingSummary, execution: TimingSummary) -> tuple[int, str]:
        """Return a level of `timing_assessment` and one line: a slow world is no fault."""
        return OK, f'the world runs at {100.0 * self.share_of_real_time:.1f} % of real time'

    def account(self) -> str:
        """Return one line for the log's end."""
        if not self.cycles:
            return 'no cycle ran'
        share = self.share_of_real_time
        text = f'{self.cycles} cycles, the world ran at {100.0 * share:.1f} % of real time'
        is_slow = share < _AS_GOOD_AS_REAL and self.slipped_ns >= _NOTICED_SLIP_NS
        if self._wait_first and is_slow:
            text += f', {self.slipped_ns * 1e-9:.2f} s behind it: too slow here for a real arm'
        return text
