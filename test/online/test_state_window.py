"""Averages of states that `StateWindow` returns."""

import numpy as np
import pytest

from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.external_torque import MeanState, StateWindow

CYCLE = 1e-3
MASS = 0.3


def windows(states: list[ArmState], dt: float) -> list[MeanState]:
    window = StateWindow()
    return [mean for state in states if (mean := window.update(state, dt)) is not None]


def pushed_mass(force: np.ndarray) -> list[ArmState]:
    """Return the states of a mass under a force per cycle."""
    dq = np.cumsum(force) * CYCLE / MASS
    return [
        ArmState(np.zeros(1), np.array([v]), np.array([f]))
        for v, f in zip(dq, force, strict=True)
    ]  # fmt: skip


def test_the_mean_torque_is_the_change_of_mean_momentum() -> None:
    force = np.random.default_rng(1).uniform(-1.0, 1.0, 60)
    means = windows(pushed_mass(force), CYCLE)
    assert [mean.states for mean in means] == [5] * 12
    for before, after in zip(means, means[1:], strict=False):
        change = MASS * (after.state.dq - before.state.dq) / after.dt
        assert after.state.tau == pytest.approx(change)
