import pytest

from aerarm_ros.description.drive_config import MotorConfig, ThermalConfig
from aerarm_ros.hardware.emulation.emulated_motor import ROOM, EmulatedHeat

MOTOR = MotorConfig('MN4006', 12, 380.0, 16.0, 1.3e-5, 0.15, thermal=ThermalConfig(6.0))


def test_a_motor_as_stated_ends_at_its_largest_temperature_under_its_continuous_current():
    heat = EmulatedHeat(MOTOR)
    for _ in range(3000):
        heat.step(6.0**2, 0.0, 1.0)
    assert heat.copper == pytest.approx(110.0, abs=0.5)
    copper, iron, housing = heat.temperatures
    assert copper > iron > housing > ROOM


def test_the_heat_that_flows_in_is_stored_or_flows_out():
    """Whatever the step: the integration is stable, and its energy balance closes."""
    fine, coarse = EmulatedHeat(MOTOR, 3), EmulatedHeat(MOTOR, 3)
    for _ in range(4000):
        fine.step(9.0**2, 0.0, 0.01)
    coarse.step(9.0**2, 0.0, 40.0)
    assert coarse.temperatures == pytest.approx(fine.temperatures, abs=0.3)


def test_resistance_grows_by_0_39_percent_per_kelvin():
    heat = EmulatedHeat(MOTOR)
    assert heat.resistance == pytest.approx(0.15)
    heat.warm(125.0)
    assert heat.resistance / 0.15 == pytest.approx(1.385, abs=0.005)


def test_iron_warms_a_motor_that_turns_without_current():
    heat = EmulatedHeat(MOTOR)
    heat.step(0.0, 150.0, 60.0)
    assert heat.temperatures[1] > ROOM + 1.0


def test_made_motors_differ():
    ends = set()
    for seed in range(5):
        heat = EmulatedHeat(MOTOR, seed)
        heat.step(8.0**2, 0.0, 60.0)
        ends.add(round(heat.copper, 3))
    assert len(ends) == 5
    assert 2.0 < max(ends) - min(ends) < 30.0
