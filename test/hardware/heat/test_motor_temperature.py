"""The estimate compared with its equations, and with independent emulated motors."""

from dataclasses import replace
from math import inf, isinf

import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drive_config import MotorConfig, ThermalConfig
from aerarm_ros.hardware.emulation.emulated_motor import EmulatedHeat
from aerarm_ros.hardware.heat_watch import MotorTemperature

THERMAL = ThermalConfig(continuous_current=6.0, temperature_max=110.0)
MOTOR = MotorConfig('MN4006', 12, 380.0, 16.0, 1.3e-5, 0.15, thermal=THERMAL)


def estimate(motor: MotorConfig = MOTOR, ambient: float = 25.0, start: float = 25.0):
    return MotorTemperature(motor, ambient, start)


@pytest.mark.parametrize('step', [0.01, 1.0, 500.0])
def test_the_continuous_current_ends_at_the_largest_temperature(step):
    motor = estimate()
    for _ in range(int(6000 / step)):
        motor.update(6.0**2, step)
    assert motor.winding == pytest.approx(110.0, abs=0.05)
    # The housing has the share of the resistance that lies outside it.
    assert motor.housing == pytest.approx(25.0 + 0.6 * 85.0, abs=0.1)


def test_a_winding_warms_with_its_time_constant_against_a_large_housing():
    thermal = replace(THERMAL, housing_time=36000.0, winding_time=10.0)
    motor = estimate(replace(MOTOR, thermal=thermal))
    motor.report(0.15)
    for _ in range(1000):
        motor.update(4.0**2, 0.01)
    rise, housing = motor.winding - 25.0, motor.housing - 25.0
    loss = 1.5 * 0.15 * 16.0
    final = loss * 0.4 * 85.0 / (1.5 * 0.15 * 1.328 * 36.0)
    # Between the loss at the cold and at the warm resistance.
    assert 0.632 * final < rise - housing < 1.08 * 0.632 * final


def test_the_time_to_a_temperature_is_that_at_which_the_estimate_reaches_it():
    motor = estimate()
    motor.report(
        0.15 * 1.3
    )  # constant and above what copper makes of it, so that nothing else varies
    predicted = motor.time_until(90.0, 10.0**2)
    time = 0.0
    while motor.winding < 90.0:
        motor.update(10.0**2, 0.01)
        time += 0.01
    assert time == pytest.approx(predicted, rel=0.01)
    assert motor.time_until(80.0, 0.0) == 0.0


def test_a_current_that_the_motor_bears_for_ever_never_reaches_the_temperature():
    assert isinf(estimate().time_until(110.0, 5.9**2))
    assert estimate().time_until(110.0, 7.0**2) < inf


@pytest.mark.parametrize(
    ('reported', 'expected'),
    [(0.20, 0.20), (0.10, 0.15), (0.0, 0.15), (5.0, 0.15)],
    ids=['larger', 'smaller', 'none', 'implausible'],
)
def test_the_larger_one_of_reported_and_known_resistance_counts(reported, expected):
    motor = estimate()
    motor.report(reported)
    assert motor.resistance(25.0) == pytest.approx(expected)


def test_a_measured_resistance_shows_a_motor_that_is_warm_at_the_start():
    hot = 0.15 * (100.0 + 234.5) / (25.0 + 234.5)
    unknown, measured = estimate(), estimate(replace(MOTOR, resistance_std=0.002))
    for motor in (unknown, measured):
        motor.report(hot)
    assert unknown.winding == 25.0
    assert measured.winding == pytest.approx(100.0, abs=1.0)


def currents(motor: MotorConfig, kind: str, time: float) -> float:
    if kind == 'continuous':
        return motor.thermal.continuous_current
    if kind == 'held':
        return 0.6 * motor.current_max if time < 25.0 else 0.0
    return 0.8 * motor.current_max if time % 4.0 < 1.0 else 0.0  # bursts


@pytest.mark.parametrize('kind', ['continuous', 'held', 'bursts'])
def test_the_estimate_follows_emulated_motors(kind: str, config: ArmConfig) -> None:
    """Of every seed: other resistances, heat capacities, one more body; see `EmulatedHeat`."""
    too_low = too_high = 0.0
    for number, motor in enumerate({joint.motor.name: joint.motor for joint in config.joints}):
        data = next(joint.motor for joint in config.joints if joint.motor.name == motor)
        for seed in range(8):
            true, known = EmulatedHeat(data, 10 * seed + number), estimate(data)
            for step in range(1200):
                current = currents(data, kind, 0.05 * step)
                true.step(current**2, 0.0, 0.05)
                known.report(true.resistance)
                known.update(current**2, 0.05)
                too_low = max(too_low, true.copper - known.winding)
                too_high = max(too_high, known.winding - true.copper)
    # Copper leads the winding with its stator while a large current begins to flow.
    assert too_low < {'continuous': 6.0, 'held': 11.0, 'bursts': 16.0}[kind]
    assert too_high < 12.0
