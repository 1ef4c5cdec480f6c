import time
from collections.abc import Callable

import pytest

from aerarm_ros.ros.emulation.emulated_world import WorldLoop

PERIOD_NS = 2_000_000


def run(
    loop: WorldLoop, cycles: int, act: Callable[[int], None] = lambda index: None
) -> tuple[list[tuple[int, int]], float]:
    """Run some cycles; return world time and index of each, and how long that took [s]."""
    calls: list[tuple[int, int]] = []

    def cycle(world_ns: int, index: int) -> None:
        calls.append((world_ns, index))
        act(index)
        if len(calls) == cycles:
            loop.stop()

    begun = time.monotonic()
    loop.run(cycle)
    return calls, time.monotonic() - begun


def grid(cycles: int, start_ns: int = 0) -> list[tuple[int, int]]:
    return [(start_ns + (index + 1) * PERIOD_NS, index) for index in range(cycles)]


def test_one_period_passes_in_a_cycle_and_no_faster_than_on_the_host() -> None:
    loop = WorldLoop(2e-3, lambda: False)
    calls, seconds = run(loop, 50)
    assert calls == grid(50)
    assert seconds >= 50 * 2e-3
    assert loop.missed == 0


def test_a_host_that_pauses_shifts_the_deadlines_and_nothing_in_the_world() -> None:
    loop = WorldLoop(2e-3, lambda: False)
    calls, seconds = run(loop, 20, lambda index: time.sleep(0.1 if index == 9 else 0.0))
    assert calls == grid(20)
    assert seconds >= 0.1 + 18 * 2e-3  # no burst makes up for the pause
    assert loop.slipped_ns >= 0.09e9
    assert loop.share_of_real_time < 0.5
    assert 'behind real time: this computer is too slow for a real arm' in loop.account()


def test_a_world_that_need_not_wait_runs_ahead() -> None:
    loop = WorldLoop(1.0, lambda: True, wait_first=False)
    calls, seconds = run(loop, 100)
    assert calls[-1][0] == 100_000_000_000
    assert seconds < 5.0
    assert loop.share_of_real_time > 20.0
    assert 'too slow' not in loop.account()


@pytest.mark.parametrize('wait_first', [True, False])
def test_is_held_before_each_cycle(wait_first: bool) -> None:
    seen: list[int] = []
    loop = WorldLoop(1e-3, lambda: bool(seen.append(loop.cycles)), wait_first)
    run(loop, 5)
    assert seen[:5] == [0, 1, 2, 3, 4]


def test_the_loop_stops_while_it_is_held_and_continues_from_an_earlier_time() -> None:
    with pytest.raises(ValueError, match='period'):
        WorldLoop(0.0, lambda: True)
    loop = WorldLoop(1e-3, lambda: bool(loop.stop()))
    loop.run(lambda *_: pytest.fail('a cycle after the stop'))
    assert loop.is_stopped
    assert loop.account() == 'no cycle has run yet'
    loop = WorldLoop(2e-3, lambda: True, False, start_ns=7)
    assert run(loop, 3)[0] == grid(3, 7)
    assert loop.world_ns == 7 + 3 * PERIOD_NS


def test_a_slip_that_no_arm_would_notice_is_no_slow_host() -> None:
    loop = WorldLoop(2e-3, lambda: False)
    loop.cycles, loop._host_ns, loop.slipped_ns = 5, 20_000_000, 10_000_000
    assert loop.share_of_real_time == 0.5
    assert 'too slow' not in loop.account()
    loop.cycles, loop._host_ns, loop.slipped_ns = 50, 200_000_000, 100_000_000
    assert '0.10 s behind real time: this computer is too slow for a real arm' in loop.account()
