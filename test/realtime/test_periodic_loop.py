"""The periodic loop, its sleep, its clock, its slack and its statistics."""

import signal
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerarm_ros.realtime import periodic_loop
from aerarm_ros.realtime.periodic_loop import (
    CycleSlack,
    PeriodicLoop,
    SteadyClock,
    TimingStatistics,
    TimingSummary,
    sleep_until,
)

MILLISECOND = 1_000_000


def run(loop: PeriodicLoop, cycles: int, busy=None) -> list[tuple[int, int]]:
    """Run some cycles; return time and index of each. `busy` maps a cycle to its length [s]."""
    calls: list[tuple[int, int]] = []

    def cycle(now_ns: int, index: int) -> None:
        assert loop.missed == index - len(calls)
        calls.append((now_ns, index))
        time.sleep((busy or {}).get(len(calls), 0.0))
        if len(calls) == cycles:
            loop.stop()

    loop.run(cycle)
    return calls


def test_deadlines_lie_on_a_grid_and_none_is_early() -> None:
    loop = PeriodicLoop(2e-3)
    before = time.monotonic_ns()
    calls = run(loop, 100)
    grid = [now - index * loop.period_ns for now, index in calls]
    # What lies above the earliest is lateness; before the start there is nothing.
    assert min(grid) >= before + loop.period_ns
    assert loop.lateness.summary().minimum >= 0.0


def test_a_long_cycle_skips_deadlines_and_counts_them() -> None:
    loop = PeriodicLoop(10e-3)
    calls = run(loop, 20, busy={5: 0.035})
    indices = [index for _, index in calls]
    assert indices[5] - indices[4] >= 4
    assert loop.cycles == 20
    # The last cycle may have been too long as well.
    assert loop.missed >= indices[-1] + 1 - 20 >= 3
    assert loop.lateness.count == loop.execution.count == 20
    assert loop.interval.count == 19
    assert loop.execution.summary().maximum >= 0.035
    assert loop.interval.summary().minimum > 0.0


def test_never_bursts_to_catch_up() -> None:
    loop = PeriodicLoop(10e-3)
    calls = run(loop, 30, busy=dict.fromkeys(range(1, 10), 0.025))
    indices = [index for _, index in calls]
    assert all(later > earlier for earlier, later in zip(indices, indices[1:], strict=False))
    start = calls[0][0] - loop.lateness.summary().maximum * 1e9
    # A cycle never starts before its own deadline, so two are never closer than the grid.
    assert all(now >= start + index * 10 * MILLISECOND for now, index in calls)


@pytest.mark.parametrize('period', [0.0, -1e-3, 1e-6, float('nan'), float('inf')])
def test_refuses_periods_that_make_no_sense(period: float) -> None:
    with pytest.raises(ValueError, match='period .* must lie between'):
        PeriodicLoop(period)


def test_never_wakes_before_the_deadline() -> None:
    for delay in (-5_000_000_000, 0, 1000, 1_000_000, 20_000_000):
        deadline = time.monotonic_ns() + delay
        sleep_until(deadline)
        assert time.monotonic_ns() >= deadline


def test_the_sleep_continues_after_a_signal_handler_and_ends_by_its_exception() -> None:
    caught = []

    def handle(*_: object) -> None:
        caught.append(time.monotonic_ns())
        if len(caught) > 1:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, handle)
    try:
        deadline = time.monotonic_ns() + 200_000_000
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        sleep_until(deadline)
        assert caught[0] < deadline <= time.monotonic_ns()
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            sleep_until(time.monotonic_ns() + 30_000_000_000)
    finally:
        signal.signal(signal.SIGALRM, before)


def test_work_begins_when_a_cycle_ends(monkeypatch):
    CycleSlack().wait()  # for a stopped loop it ends soon
    monkeypatch.setattr(periodic_loop, '_PATIENCE', 3600.0)
    slack, begun = CycleSlack(), threading.Event()
    slack.begin()  # a cycle that ended before anybody waited does not count

    def work():
        slack.wait()
        begun.set()

    thread = threading.Thread(target=work)
    thread.start()
    assert not begun.wait(0.05)
    end = time.monotonic() + 60.0
    while not begun.is_set() and time.monotonic() < end:
        slack.begin()
        time.sleep(1e-3)
    assert begun.is_set()
    thread.join()


class Clocks:
    """A monotonic clock and a system clock that can be set."""

    def __init__(self) -> None:
        self.monotonic, self.system = 5 * 10**9, 10**18

    def pass_time(self, duration: int) -> None:
        self.monotonic += duration
        self.system += duration


def stamps_of(clock: SteadyClock, clocks: Clocks, cycles: int) -> np.ndarray:
    stamps = []
    for _ in range(cycles):
        clocks.pass_time(MILLISECOND)
        stamps.append(clock.now_ns())
    return np.array(stamps)


def make() -> tuple[SteadyClock, Clocks]:
    clocks = Clocks()
    return SteadyClock(lambda: clocks.system, lambda: clocks.monotonic), clocks


def test_steps_of_the_system_time_are_followed_slowly() -> None:
    clock, clocks = make()
    stamps_of(clock, clocks, 100)
    assert clock.now_ns() == clocks.system
    for step in (-50 * MILLISECOND, 30 * MILLISECOND):
        clocks.system += step
        stamps = stamps_of(clock, clocks, 1000)
        assert np.all(np.abs(np.diff(stamps) - MILLISECOND) <= 500e-6 * MILLISECOND)
    stamps_of(clock, clocks, 100_000)
    assert clock.now_ns() == clocks.system


@pytest.mark.parametrize('step', [0.6, -0.6, 5.0, -5.0, 3600.0, -3600.0])
def test_a_clock_that_is_set_while_the_arm_moves_is_followed_later(step: float) -> None:
    clock, clocks = make()
    clock.may_step = False
    clocks.system += round(step * 1e9)
    stamps = stamps_of(clock, clocks, 1000)
    assert np.all(np.abs(np.diff(stamps) - MILLISECOND) <= 500e-6 * MILLISECOND)
    assert clock.behind == pytest.approx(step, abs=1e-3)
    clock.may_step = True
    assert stamps_of(clock, clocks, 1)[0] == clocks.system
    assert clock.behind == 0.0


@given(st.lists(st.integers(0, 30_000_000), min_size=1, max_size=300))
def test_agrees_with_numpy_to_one_bin(durations_ns: list[int]) -> None:
    statistics = TimingStatistics(resolution=10e-6, span=20e-3)
    for duration in durations_ns:
        statistics.add(duration)
    summary = statistics.summary()
    seconds = np.array(durations_ns) / 1e9
    assert summary.count == len(seconds)
    np.testing.assert_allclose(summary.mean, seconds.mean(), rtol=1e-9)
    np.testing.assert_allclose(summary.std, seconds.std(), rtol=1e-6, atol=1e-12)
    assert (summary.minimum, summary.maximum) == (seconds.min(), seconds.max())
    for share, found in ((0.5, summary.p50), (0.99, summary.p99), (0.999, summary.p999)):
        exact = np.quantile(seconds, share, method='inverted_cdf')
        if exact < 20e-3:
            assert exact <= found <= exact + 10e-6
        else:
            assert found == summary.maximum


def test_statistics_of_nothing_of_one_and_of_an_early_wake_up() -> None:
    statistics = TimingStatistics()
    assert statistics.summary() == TimingSummary()
    statistics.add(-2000)
    summary = statistics.summary()
    assert (summary.count, summary.maximum, summary.std) == (1, -2e-6, 0.0)
    statistics.add(1000)
    assert statistics.summary().minimum == -2e-6
