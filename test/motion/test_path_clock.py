"""Smooth stops of the time along a motion."""

import numpy as np

from aerarm_ros.motion.path_clock import PathClock


def test_runs_with_time_until_stopped() -> None:
    clock = PathClock(0.5)
    assert clock.at(1.25) == (1.25, 1.0, 0.0)
    assert not clock.stopping
    clock.stop(1.3)
    clock.stop(1.4)  # too late to matter
    assert clock.stopping
    assert clock.at(1.3).value == 1.3
    assert not clock.stopped(1.79)
    assert clock.stopped(1.81)
    assert clock.at(5.0) == (1.55, 0.0, 0.0)


def test_rate_and_its_change_are_derivatives() -> None:
    clock = PathClock(0.5)
    clock.stop(1.0)
    now = np.linspace(0.9, 1.6, 7001)
    path = np.array([clock.at(t) for t in now])
    np.testing.assert_allclose(np.gradient(path[:, 0], now)[1:-1], path[1:-1, 1], atol=1e-3)
    np.testing.assert_allclose(np.gradient(path[:, 1], now)[1:-1], path[1:-1, 2], atol=1e-2)
    assert (np.diff(path[:, 0]) >= 0.0).all()
