import numpy as np
import pytest

from aerarm_ros.realtime.periodic_loop import SteadyClock

MILLISECOND = 1_000_000


class Clocks:
    """A monotonic clock and a system clock that can be set."""

    def __init__(self) -> None:
        self.monotonic, self.system = 5 * 10**9, 10**18

    def pass_time(self, duration: int) -> None:
        self.monotonic += duration
        self.system += duration


def run(clock: SteadyClock, clocks: Clocks, cycles: int) -> np.ndarray:
    stamps = []
    for _ in range(cycles):
        clocks.pass_time(MILLISECOND)
        stamps.append(clock.now_ns())
    return np.array(stamps)


def make() -> tuple[SteadyClock, Clocks]:
    clocks = Clocks()
    return SteadyClock(lambda: clocks.system, lambda: clocks.monotonic), clocks


def test_is_the_system_time_while_that_is_steady() -> None:
    clock, clocks = make()
    stamps = run(clock, clocks, 100)
    assert stamps[-1] == clocks.system
    assert np.all(np.diff(stamps) == MILLISECOND)


def test_steps_of_the_system_time_are_followed_slowly() -> None:
    clock, clocks = make()
    for step in (-50 * MILLISECOND, 30 * MILLISECOND):
        clocks.system += step
        stamps = run(clock, clocks, 1000)
        assert np.all(np.abs(np.diff(stamps) - MILLISECOND) <= 500e-6 * MILLISECOND)
    run(clock, clocks, 100_000)
    assert clock.now_ns() == clocks.system


def test_a_clock_that_is_set_is_followed_at_once() -> None:
    clock, clocks = make()
    clocks.system += 3600 * 10**9
    assert run(clock, clocks, 1)[0] == clocks.system


@pytest.mark.parametrize('step', [0.6, -0.6, 5.0, -5.0, 3600.0, -3600.0])
def test_a_clock_that_is_set_while_the_arm_moves_is_followed_later(step: float) -> None:
    clock, clocks = make()
    clock.may_step = False
    clocks.system += round(step * 1e9)
    stamps = run(clock, clocks, 1000)
    assert np.all(np.abs(np.diff(stamps) - MILLISECOND) <= 500e-6 * MILLISECOND)
    assert clock.behind == pytest.approx(step, abs=1e-3)
    clock.may_step = True
    assert run(clock, clocks, 1)[0] == clocks.system
    assert clock.behind == 0.0


def test_follows_the_real_clock() -> None:
    clock = SteadyClock()
    stamps = [clock.now_ns() for _ in range(10_000)]
    assert np.all(np.diff(stamps) >= 0)
