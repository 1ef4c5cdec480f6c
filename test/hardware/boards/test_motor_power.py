import numpy as np
import pytest

from aerarm_ros.hardware.boards.board_link import MotorPower
from aerarm_ros.hardware.frames.frame_profile import load_profile

CURRENT = np.array([2.0, -1.0, 0.5, 0.0])
SPEED = np.array([10.0, 20.0, -30.0, 5.0])


def test_without_voltages_it_is_joule_loss_plus_mechanical_power(config):
    power = MotorPower(config, load_profile())
    power.update(CURRENT, SPEED, np.zeros(4), 1e-3)
    joule = 1.5 * config.column('motor.resistance') * CURRENT**2
    mechanical = config.column('motor.torque_constant') * CURRENT * SPEED
    assert power.source == 'model'
    assert power.watts == pytest.approx(joule + mechanical)


def test_with_voltages_it_is_measured(config):
    power = MotorPower(config, load_profile('laas_power'))
    power.update(CURRENT, SPEED, np.array([3.0, -2.0, 1.0, 7.0]), 1e-3)
    assert power.source == 'voltage'
    assert power.watts == pytest.approx([9.0, 3.0, 0.75, 0.0])


def test_energy_is_the_integral_and_waits_for_the_first_states(config):
    power = MotorPower(config, load_profile('laas_power'))
    power.update(np.full(4, np.nan), SPEED, SPEED, 1e-3)
    assert not power.energy.any()
    for _ in range(1000):
        power.update(CURRENT, SPEED, np.ones(4), 1e-3)
    assert power.energy == pytest.approx(1.5 * CURRENT)
