"""Energy balance, drive power and holding loss against their definitions."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import PowerStageConfig
from aerarm_ros.description.config_reader import ConfigError
from aerarm_ros.energy.energy_model import DrivePower, EnergyModel, HoldingLoss
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


TAU = np.array([2.0, -3.0, 1.0, 0.5])
DQ = np.array([1.0, 0.5, -2.0, 0.0])


def test_power_is_that_of_the_motors_by_current_and_speed(config) -> None:
    """Thesis (4.1), on the motor's side of the gear."""
    current = TAU / config.column('torque_per_ampere')
    speed = DQ / config.column('gear.ratio')
    copper = 1.5 * config.column('motor.resistance') * current**2
    expected = copper + config.column('motor.torque_constant') * current * speed
    np.testing.assert_allclose(DrivePower(config).electrical(TAU, DQ), expected)


def test_braking_power_comes_back_as_far_as_the_power_stage_lets_it(config) -> None:
    stage = PowerStageConfig(recovery=0.6)
    drives = DrivePower(replace(config, power_stage=stage))
    np.testing.assert_allclose(drives.from_supply([-2.0, 3.0]), [-1.2, 3.0])
    assert DrivePower(config).from_supply(-2.0) == 0.0


@pytest.mark.parametrize('wrong', [{'recovery': 1.1}, {'standby': -1.0}])
def test_a_power_stage_that_cannot_be_is_refused(wrong) -> None:
    with pytest.raises(ConfigError, match=f'power_stage: {next(iter(wrong))}'):
        PowerStageConfig(**wrong)


def test_the_gradient_is_that_of_the_loss(model) -> None:
    loss = HoldingLoss(model)
    rng = np.random.default_rng(3)
    for q in rng.uniform(-1.5, 1.5, (5, 4)):
        numeric = [
            (loss.watts(q + step) - loss.watts(q - step)) / 2e-6 for step in 1e-6 * np.eye(4)
        ]
        np.testing.assert_allclose(loss.gradient(q), numeric, atol=1e-5)


def test_the_table_adds_up(model, config) -> None:
    balance = model.balance(MOTION)
    last = (balance + balance).as_text(config.joint_names).splitlines()[-1].split()
    assert last[0] == 'all'
    assert sum(map(float, last[1:8])) == pytest.approx(float(last[8]), abs=0.01)
