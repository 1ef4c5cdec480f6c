import time

import pytest

from aerarm_ros.realtime.periodic_loop import PeriodicLoop

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


def test_never_bursts_to_catch_up() -> None:
    loop = PeriodicLoop(10e-3)
    calls = run(loop, 30, busy=dict.fromkeys(range(1, 10), 0.025))
    indices = [index for _, index in calls]
    assert all(later > earlier for earlier, later in zip(indices, indices[1:], strict=False))
    start = calls[0][0] - loop.lateness.summary().maximum * 1e9
    # A cycle never starts before its own deadline, so two are never closer than the grid.
    assert all(now >= start + index * 10 * MILLISECOND for now, index in calls)


def test_measures_each_cycle() -> None:
    loop = PeriodicLoop(5e-3)
    run(loop, 10, busy={3: 0.012})
    assert loop.lateness.count == loop.execution.count == 10
    assert loop.interval.count == 9
    assert loop.execution.summary().maximum >= 0.012
    assert loop.interval.summary().minimum > 0.0


def test_stop_before_the_start_counts() -> None:
    loop = PeriodicLoop(1e-3)
    loop.stop()
    loop.run(lambda *_: pytest.fail('a stopped loop ran'))


def test_an_error_in_the_cycle_comes_out() -> None:
    def cycle(now_ns: int, index: int) -> None:
        raise RuntimeError('board gone')

    with pytest.raises(RuntimeError, match='board gone'):
        PeriodicLoop(1e-3).run(cycle)


@pytest.mark.parametrize('period', [0.0, -1e-3, 1e-6, float('nan'), float('inf')])
def test_refuses_periods_that_make_no_sense(period: float) -> None:
    with pytest.raises(ValueError, match='period .* must lie between'):
        PeriodicLoop(period)
