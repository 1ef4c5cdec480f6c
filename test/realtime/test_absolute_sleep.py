import signal
import time

import pytest

from aerarm_ros.realtime.periodic_loop import sleep_until


def test_never_wakes_before_the_deadline() -> None:
    for delay in (0, 1000, 1_000_000, 20_000_000):
        deadline = time.monotonic_ns() + delay
        sleep_until(deadline)
        assert time.monotonic_ns() >= deadline


def test_a_past_deadline_returns() -> None:
    sleep_until(0)
    sleep_until(time.monotonic_ns() - 5_000_000_000)


def test_the_sleep_continues_after_a_signal_handler() -> None:
    caught = []
    before = signal.signal(signal.SIGALRM, lambda *_: caught.append(time.monotonic_ns()))
    try:
        deadline = time.monotonic_ns() + 1_000_000_000
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        sleep_until(deadline)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert caught
    assert caught[0] < deadline <= time.monotonic_ns()


def test_an_exception_of_a_signal_handler_ends_the_sleep() -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            sleep_until(time.monotonic_ns() + 30_000_000_000)
    finally:
        signal.signal(signal.SIGALRM, before)
