"""System time that never steps."""

from __future__ import annotations

import time
from collections.abc import Callable

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
