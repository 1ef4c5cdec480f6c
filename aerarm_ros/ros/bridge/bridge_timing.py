"""How the bridge's loop keeps its time, as a diagnostic status."""

from __future__ import annotations

from collections.abc import Iterator

from diagnostic_msgs.msg import DiagnosticStatus

from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.realtime.steady_clock import SteadyClock
from aerarm_ros.realtime.timing_assessment import WARN
from aerarm_ros.realtime.timing_statistics import TimingStatistics
from aerarm_ros.realtime.timing_summary import TimingSummary

# [s] A larger difference between the stamps and the system clock is a warning.
_BEHIND_MAX = 0.02
_LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)


class BridgeTiming:
    """Statistics of a loop and of the commands that reach it.

    Parameters
    ----------
    loop
        The cycle's loop.
    stamps
        Clock of the states' stamps.
    """

    def __init__(self, loop: PeriodicLoop, stamps: SteadyClock) -> None:
        self._loop, self._stamps = loop, stamps
        self._command_age = TimingStatistics()
        self._answered = 0
        self._summaries: dict[str, TimingSummary] = {}

    def add_command(self, age_ns: int, answers_last_state: bool) -> None:
        """Count a command: time since the state it answers [ns], and whether that was the last."""
        self._command_age.add(age_ns)
        self._answered += answers_last_state

    def account(self) -> str:
        """Return one line about the loop, for the log's end."""
        return self._loop.account()

    def refresh(self) -> Iterator[None]:
        """Evaluate the statistics for `status`, one between two yields: each takes 0.1 ms."""
        loop = self._loop
        for name, statistics in (
            ('period', loop.interval),
            ('wake lateness', loop.lateness),
            ('execution time', loop.execution),
            ('command age', self._command_age),
        ):
            self._summaries[name] = statistics.summary()
            yield

    def status(self) -> tuple[bytes, str, dict[str, object]]:
        """Return level, message and values of the status, as of the last `refresh`."""
        loop, summaries = self._loop, self._summaries
        level, text = loop.assess(summaries['period'], summaries['execution time'])
        behind = self._stamps.behind
        if abs(behind) > _BEHIND_MAX:
            level = max(level, WARN)
            text = f'{text}; {_behind_text(behind)}'
        values: dict[str, object] = {
            'cycles': loop.cycles,
            'missed cycles': loop.missed,
            'commands answering the last state': self._answered,
            'stamps behind the system clock [ms]': f'{1e3 * behind:.1f}',
        }
        for name, summary in summaries.items():
            values.update(_rows(name, summary))
        return _LEVELS[level], text, values


def _behind_text(behind: float) -> str:
    where = 'behind' if behind > 0.0 else 'ahead of'
    return (
        f'the stamps are {1e3 * abs(behind):.0f} ms {where} the system clock, which was set: give '
        'no start times and no stamps by the system clock until they agree '
        "(after 'arm disable' at once if it is more than 500 ms, else by 0.5 ms per second)"
    )


def _rows(name: str, summary: TimingSummary) -> dict[str, str]:
    fields = {
        'mean': summary.mean,
        'std': summary.std,
        'p50': summary.p50,
        'p99': summary.p99,
        'p99.9': summary.p999,
        'max': summary.maximum,
    }
    return {f'{name} {key} [us]': _us(value) for key, value in fields.items()}


def _us(seconds: float) -> str:
    return f'{seconds * 1e6:.0f}'
