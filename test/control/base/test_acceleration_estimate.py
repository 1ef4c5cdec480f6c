import numpy as np
import pytest

from aerarm_ros.control.base.base_motion_estimator import AccelerationEstimate

CYCLE = 1e-3


def test_follows_a_slow_motion_with_the_lag_it_states() -> None:
    estimate = AccelerationEstimate(1, cutoff=20.0)
    lag = 1.0 / (2.0 * np.pi * 20.0)
    for cycle in range(3000):
        now = cycle * CYCLE
        value = estimate.update(np.array([np.sin(3.0 * now)]), CYCLE)
        if cycle > 300:
            assert value[0] == pytest.approx(3.0 * np.cos(3.0 * (now - lag)), abs=0.02)


def test_starts_and_restarts_at_zero() -> None:
    estimate = AccelerationEstimate(2)
    assert not estimate.update(np.ones(2), CYCLE).any()
    estimate.update(np.full(2, 5.0), CYCLE)
    estimate.reset()
    assert not estimate.update(np.full(2, -3.0), CYCLE).any()
