from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import PowerStageConfig
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.motion.polynomial_path import PolynomialPath

MOTION = PolynomialPath.rest_to_rest(
    np.array([0.2, 0.4, 1.0, -1.0]), np.array([-1.0, 2.4, 0.0, 1.0]), 1.5
)


def test_supplied_is_the_integral_of_the_power_that_the_supply_gives(model) -> None:
    times = (np.arange(3000) + 0.5) * MOTION.duration / 3000
    power = model.drives.from_supply(model.power(MOTION, times))
    expected = power.mean(axis=0) * MOTION.duration
    balance = model.balance(MOTION)
    np.testing.assert_allclose(balance.motors, expected, rtol=1e-3, atol=1e-4)
    assert balance.unexplained == pytest.approx(0.0, abs=1e-9)


def test_work_against_gravity_and_inertia_equals_the_stored_energy(model) -> None:
    balance, dynamics = model.balance(MOTION), model.dynamics
    q0, q1 = MOTION.evaluate(0.0).q, MOTION.evaluate(MOTION.duration).q
    lifted = dynamics.potential_energy(q1) - dynamics.potential_energy(q0)
    assert balance.gravity.sum() == pytest.approx(lifted, abs=1e-4)
    assert balance.inertia.sum() == pytest.approx(0.0, abs=1e-4)


def test_recovery_reduces_burnt_energy_and_standby_is_added(config, robot) -> None:
    def of(**stage: float):
        arm = replace(config, power_stage=PowerStageConfig(**stage))
        return EnergyModel(arm, robot).balance(MOTION)

    none, half = of(), of(recovery=0.5, standby=3.0)
    assert none.burnt.sum() > 0.1
    np.testing.assert_allclose(half.recovered, 0.5 * none.burnt)
    np.testing.assert_allclose(half.burnt, 0.5 * none.burnt)
    assert half.standby.sum() == pytest.approx(4.5)
    np.testing.assert_allclose(half.motors, none.motors - half.recovered)


def test_gears_transmit_the_torque_of_the_links_only(config, robot) -> None:
    light, heavy = (
        EnergyModel(config, robot, rotors, load_friction=0.1).balance(MOTION)
        for rotors in (np.zeros(4), np.full(4, 2.0))
    )
    np.testing.assert_allclose(heavy.friction, light.friction, rtol=1e-9)
    assert heavy.copper.sum() > 2.0 * light.copper.sum()


def test_a_payload_costs(model, config, robot) -> None:
    laden = EnergyModel(config, robot)
    laden.carry([0.2, 0.02, 0, 0, 0, 0, 2e-3, 0, 0, 2e-3])
    assert (
        laden.balance(MOTION).motors.sum() > EnergyModel(config, robot).balance(MOTION).motors.sum()
    )


def test_the_table_adds_up(model, config) -> None:
    balance = model.balance(MOTION)
    twice = balance + balance
    np.testing.assert_allclose(twice.supplied, 2.0 * balance.supplied)
    last = twice.as_text(config.joint_names).splitlines()[-1].split()
    assert last[0] == 'all'
    assert sum(map(float, last[1:8])) == pytest.approx(float(last[8]), abs=0.01)
