"""The energy balance from the bridge's topics, compared with the emulated motors' power."""

import numpy as np
import pytest
from metered_arm import Meter, MeteredArm

from aerarm_ros.energy.energy_model import BalanceMeter, EnergyBalance
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import ArmState

# Lifted and lowered, so that motors drive and brake.
MOTION = PolynomialPath.rest_to_rest(
    np.array([0.0, 1.9, 0.3, 0.4]), np.array([0.8, 0.9, -0.5, -0.6]), 1.2
)


@pytest.fixture(scope='module')
def played(config, robot) -> tuple[Meter, list]:
    return MeteredArm(config, robot, MOTION.evaluate(0.0).q).play(MOTION)


@pytest.fixture(scope='module')
def measured(model, played) -> EnergyBalance:
    meter = BalanceMeter(model)
    for state in played[1]:
        meter.add(*state)
    assert meter.gaps == 0
    return meter.total


def test_the_balance_is_that_of_the_emulated_motors(played, measured) -> None:
    truth, whole = played[0], truth_of(played[0])
    for mine, true in (
        (measured.copper, truth.copper),
        (measured.friction, truth.friction),
        (measured.motors, truth.supplied),
    ):
        assert mine.sum() == pytest.approx(true.sum(), rel=0.02)
        np.testing.assert_allclose(mine, true, rtol=0.03, atol=2e-3)
    stored = measured.gravity.sum() + measured.inertia.sum()
    assert stored == pytest.approx(truth.stored, abs=0.02 * whole)
    assert abs(measured.unexplained.sum()) < 0.01 * whole


def test_the_balance_equals_the_sum_of_motor_power(played, measured) -> None:
    assert measured.motors.sum() == pytest.approx(played[0].told.sum(), rel=0.02)


def test_measured_energy_agrees_with_the_plan(model, measured) -> None:
    planned = model.balance(MOTION)
    assert planned.motors.sum() == pytest.approx(measured.motors.sum(), rel=0.05)
    assert planned.seconds == pytest.approx(measured.seconds, abs=0.02)


def test_states_without_torque_and_gaps_are_left_out(model) -> None:
    rest = ArmState(np.zeros(4), np.zeros(4), np.ones(4))
    meter = BalanceMeter(model)
    for k in range(101):
        meter.add(1e-3 * k, rest)
    before = meter.total.seconds
    assert before == pytest.approx(0.1)
    meter.add(5.0, rest)  # the arm may have been anywhere
    meter.add(5.001, rest._replace(tau=np.full(4, np.nan)))
    assert (meter.gaps, meter.total.seconds) == (2, before)


def truth_of(meter: Meter) -> float:
    return float(meter.supplied.sum())
