"""Time along a motion, which a stop slows down smoothly."""

from __future__ import annotations

from typing import NamedTuple

from aerarm_ros.motion.smooth_step import smooth_step


class PathTime(NamedTuple):
    """Time along the motion [s], its rate, and the rate's derivative [1/s]."""

    value: float
    rate: float
    rate_change: float


class PathClock:
    """Runs with time until it is stopped, and then falls to rest along a quintic step.

    Stopping the clock stops the arm on its path, whose postures are checked, with continuous
    velocity and acceleration.

    Parameters
    ----------
    stop_time : how long a stop takes [s].
    """

    def __init__(self, stop_time: float) -> None:
        self._stop_time = stop_time
        self._stop_at: float | None = None

    @property
    def stopping(self) -> bool:
        """Whether a stop was asked for."""
        return self._stop_at is not None

    def stop(self, now: float) -> None:
        """Begin to stop at `now` [s] since the start; a second call changes nothing."""
        if self._stop_at is None:
            self._stop_at = now

    def stopped(self, now: float) -> bool:
        """Return whether the clock stands still at `now` [s]."""
        return self._stop_at is not None and now >= self._stop_at + self._stop_time

    def at(self, now: float) -> PathTime:
        """Return the time along the motion at `now` [s] since the start."""
        if self._stop_at is None:
            return PathTime(now, 1.0, 0.0)
        x = min((now - self._stop_at) / self._stop_time, 1.0)
        step = smooth_step(x)
        return PathTime(
            self._stop_at + self._stop_time * (x - float(step.integral)),
            1.0 - float(step.value),
            -float(step.slope) / self._stop_time,
        )
