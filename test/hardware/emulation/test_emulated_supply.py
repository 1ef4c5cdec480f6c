from math import sqrt

import pytest

from aerarm_ros.hardware.emulation.emulated_board import EmulatedSupply


def test_a_battery_sags_under_a_load_and_takes_braking_power_back():
    supply = EmulatedSupply()
    supply.step(240.0, 1e-3)
    assert supply.voltage == pytest.approx(24.0 - 0.05 * 10.0)
    supply.step(-240.0, 1e-3)
    assert supply.voltage == pytest.approx(24.5)


def test_braking_energy_that_the_supply_rejects_charges_the_capacitors():
    supply = EmulatedSupply()
    supply.capacitance = 1e-3
    for _ in range(100):
        supply.step(-10.0, 1e-3)
    assert supply.voltage == pytest.approx(sqrt(24.0**2 + 2.0 * 1.0 / 1e-3))
    for _ in range(200):
        supply.step(10.0, 1e-3)  # motors take it again first
    assert supply.voltage == pytest.approx(24.0, abs=0.1)
