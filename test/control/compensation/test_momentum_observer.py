"""The observer estimates unknown forces with its nominal time constant."""

import numpy as np
import pytest

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.compensation import MomentumObserver
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.motion.signals import ArmState, JointReference

CYCLE = 1e-3
GAIN = 40.0
UPRIGHT = np.array([0.0, 1.5708, 0.0, 0.0])
FORCE = np.array([0.4, -0.6, 0.2, 0.15])


def swing(now: float) -> JointReference:
    amplitude, rate = np.array([0.5, 0.4, 0.6, 0.7]), np.array([2.0, 3.0, 2.5, 3.5])
    return JointReference(
        UPRIGHT + amplitude * (1.0 - np.cos(rate * now)),
        amplitude * rate * np.sin(rate * now),
        amplitude * rate**2 * np.cos(rate * now),
    )


def observe(dynamics, bench, reference, force, seconds, gain=GAIN):
    law = ComputedTorque(dynamics, 100.0, 20.0)
    observer = MomentumObserver(dynamics, gain)
    residuals = []

    def controller(state, now):
        residuals.append(observer.update(state, CYCLE))
        return law.update(state, reference(now), CYCLE)

    run = bench(reference(0.0).q).run(controller, seconds, disturbance=force)
    return run.time, np.array(residuals)


def test_converges_on_a_known_force_with_its_time_constant(dynamics, frictionless_bench) -> None:
    time, residual = observe(dynamics, frictionless_bench, swing, FORCE, 1.0)
    np.testing.assert_allclose(residual[-1], FORCE, atol=0.01)
    predicted = np.outer(1.0 - np.exp(-GAIN * time), FORCE)
    assert np.abs(residual - predicted).max() < 0.05 * np.abs(FORCE).max()


def test_stays_at_zero_while_nothing_disturbs(dynamics, frictionless_bench) -> None:
    _, residual = observe(dynamics, frictionless_bench, swing, 0.0, 1.0)
    assert np.abs(residual).max() < 0.01


def test_is_stable_for_any_gain(dynamics, frictionless_bench) -> None:
    _, residual = observe(dynamics, frictionless_bench, swing, FORCE, 0.5, gain=1e5)
    np.testing.assert_allclose(residual[-1], FORCE, atol=0.05)


def test_knows_that_the_base_moves(dynamics) -> None:
    """An arm held by exactly the torque for the moving base shows no disturbance."""
    base = BaseMotion(
        np.array([0.0, 0.0, -9.81]), np.array([3.0, -2.0, 12.0]), np.array([1.0, 2.0, -0.5]),
        np.array([4.0, -3.0, 2.0]),
    )  # fmt: skip
    tau = dynamics.inverse(UPRIGHT, np.zeros(4), np.zeros(4), base)
    state = ArmState(UPRIGHT, np.zeros(4), tau)
    aware, unaware = (MomentumObserver(dynamics, GAIN) for _ in range(2))
    for _ in range(500):
        aware.update(state, CYCLE, base)
        unaware.update(state, CYCLE)
    np.testing.assert_allclose(aware.residual, 0.0, atol=1e-12)
    assert np.abs(unaware.residual).max() > 0.2


def test_reset_forgets(dynamics) -> None:
    observer = MomentumObserver(dynamics, GAIN)
    state = ArmState(UPRIGHT, np.zeros(4), np.ones(4))
    for _ in range(100):
        observer.update(state, CYCLE)
    assert observer.residual.any()
    observer.reset()
    assert not observer.residual.any()
    assert not observer.update(state, CYCLE).any()


def test_a_negative_gain_is_refused(dynamics) -> None:
    with pytest.raises(ValueError, match='gain'):
        MomentumObserver(dynamics, -1.0)
