"""Whether a loop keeps its time, with the thresholds ros2_control uses."""

from __future__ import annotations

from dataclasses import dataclass

from aerarm_ros.realtime.timing_summary import TimingSummary

OK, WARN, ERROR = 0, 1, 2


@dataclass(frozen=True)
class TimingThresholds:
    """Pairs of (warning, error) levels; the defaults are ros2_control's.

    Attributes
    ----------
    rate_error
        Deviation of the mean rate from the wanted one [Hz].
    execution_mean, execution_std
        Mean and standard deviation of the execution time [s].
    """

    rate_error: tuple[float, float] = (5.0, 10.0)
    execution_mean: tuple[float, float] = (1000e-6, 2000e-6)
    execution_std: tuple[float, float] = (100e-6, 200e-6)


def assess_timing(
    period: float,
    interval: TimingSummary,
    execution: TimingSummary,
    thresholds: TimingThresholds | None = None,
) -> tuple[int, str]:
    """Return the worst level and what it is about.

    Parameters
    ----------
    period
        Wanted period [s].
    interval, execution
        Measured periods and execution times.
    thresholds
        ros2_control's by default.
    """
    limits = thresholds or TimingThresholds()
    if not interval.count:
        return OK, 'no cycle yet'
    rate = 1.0 / interval.mean
    checks = (
        (abs(rate - 1.0 / period), limits.rate_error, f'rate is {rate:.1f} Hz'),
        (
            execution.mean,
            limits.execution_mean,
            f'a cycle takes {execution.mean * 1e6:.0f} us on average',
        ),
        (
            execution.std,
            limits.execution_std,
            f'cycle times spread by {execution.std * 1e6:.0f} us',
        ),
    )
    levels = [
        (ERROR if value > error else WARN if value > warn else OK, text)
        for value, (warn, error), text in checks
    ]
    worst = max(level for level, _ in levels)
    if worst == OK:
        return OK, f'{rate:.1f} Hz, {execution.mean * 1e6:.0f} us a cycle'
    return worst, '; '.join(text for level, text in levels if level == worst)
