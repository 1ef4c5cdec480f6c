"""The observer estimates unknown forces with its nominal time constant."""

import numpy as np
import pytest

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.compensation import ErrorIntegral, FrictionCompensation, MomentumObserver
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.model.regressor import viscous_coulomb
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


def test_the_integral_grows_with_the_error_and_does_not_wind_up() -> None:
    integral = ErrorIntegral([2.0, 0.0], [10.0, 10.0])
    for _ in range(1000):
        value = integral.update(np.array([0.5, 0.5]), 1e-3)
    np.testing.assert_allclose(value, [1.0, 0.0])
    for _ in range(1000):
        integral.update(np.array([5.0, 0.0]), 1e-2)
    assert integral.update(np.array([-5.0, 0.0]), 1e-2)[0] == pytest.approx(9.9)


VISCOUS, COULOMB = np.array([0.006, 0.003]), np.array([0.25, 0.1])


def test_is_zero_at_rest_and_small_for_velocity_noise() -> None:
    compensation = FrictionCompensation(VISCOUS, COULOMB, width=0.03)
    assert not compensation.torque(np.zeros(2)).any()
    noise = np.random.default_rng(0).normal(scale=1e-3, size=(1000, 2))
    torques = np.array([compensation.torque(dq) for dq in noise])
    # A switching compensation would jump by 2 fs at every change of sign.
    assert np.all(np.abs(torques).max(axis=0) < 0.15 * COULOMB)


def test_a_loaded_gear_loses_a_fraction_of_the_transmitted_torque() -> None:
    share = np.array([0.04, 0.02])
    compensation = FrictionCompensation(VISCOUS, COULOMB, load_share=share)
    dq, load = np.array([0.5, -0.5]), np.array([-1.5, 2.0])
    np.testing.assert_allclose(
        compensation.torque(dq, load),
        viscous_coulomb(dq, VISCOUS, COULOMB + share * np.abs(load)),
        atol=1e-8,
    )
    np.testing.assert_array_equal(compensation.torque(np.zeros(2), load), np.zeros(2))


def test_with_a_fraction_below_one_friction_still_wins_at_every_velocity() -> None:
    compensation = FrictionCompensation(VISCOUS, COULOMB, fraction=0.8)
    for speed in np.linspace(-3.0, 3.0, 601):
        dq = np.full(2, speed)
        left = viscous_coulomb(dq, VISCOUS, COULOMB) - compensation.torque(dq)
        assert np.all(left * dq >= 0.0)


def test_slopes_are_the_derivatives_of_the_torque() -> None:
    friction = FrictionCompensation([0.1, 0.2], [0.3, 0.4], 0.05, load_share=[0.02, 0.04])
    dq, load, h = np.array([0.03, -0.4]), np.array([-2.0, 1.0]), 1e-7
    by_velocity, by_load = friction.slopes(dq, load)
    numeric = (friction.torque(dq + h, load) - friction.torque(dq - h, load)) / (2.0 * h)
    np.testing.assert_allclose(by_velocity, numeric, rtol=1e-5)
    numeric = (friction.torque(dq, load + h) - friction.torque(dq, load - h)) / (2.0 * h)
    np.testing.assert_allclose(by_load, numeric, rtol=1e-5)
