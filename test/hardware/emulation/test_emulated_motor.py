import numpy as np
import pytest

from aerarm_ros.description.drive_config import MotorConfig, ThermalConfig
from aerarm_ros.hardware.emulation.emulated_motor import (
    ROOM,
    AlignmentTiming,
    EmulatedHeat,
    EmulatedMotor,
)

SUBSTEP = 0.25e-3
MOTOR = MotorConfig('MN4006', 12, 380.0, 16.0, 1.3e-5, 0.15)
TIMING = AlignmentTiming(0.2, 0.2, 0.05)


def follow_the_field(motor, slip=0.0):
    """Align a motor whose rotor follows its field, or stands still with slip = 1."""
    angle = 0.0
    for step in range(round(TIMING.total / SUBSTEP) + 2):
        time = step * SUBSTEP
        turn = time / 0.2 if time < 0.2 else max(0.0, 2.0 - time / 0.2)
        angle = (1.0 - slip) * 2 * np.pi * turn / MOTOR.pole_pairs
        motor.step(angle)
        if motor.ready or motor.alignment_failed:
            break
    return angle


@pytest.fixture
def motor():
    motor = EmulatedMotor(MOTOR, SUBSTEP, TIMING)
    motor.enable(True)
    follow_the_field(motor)
    assert motor.ready
    return motor


def settled(motor, angle=0.0, steps=100):
    for _ in range(steps):
        motor.step(angle)
    return motor.torque_current


def test_law_4_4_in_the_steady_state(motor):
    motor.kp, motor.kd = 2.0, 0.1
    motor.position, motor.velocity, motor.current = 0.5, 3.0, 0.4
    measured = motor.encoder.position
    assert settled(motor) == pytest.approx(2.0 * (0.5 - measured) + 0.1 * 3.0 + 0.4, abs=1e-4)


def test_current_follows_its_reference_as_a_first_order_system(motor):
    motor.current = 1.0
    rise = []
    for _ in range(8):
        motor.step(0.0)
        rise.append(motor.torque_current)
    assert np.all(np.diff(rise) > 0.0)
    assert rise == pytest.approx(1 - np.exp(-2 * np.pi * 1000 * SUBSTEP * np.arange(1, 9)))


def test_integral_gain_integrates_the_position_error_and_does_not_wind_up(motor):
    motor.integral_gain, motor.position = 4.0, motor.encoder.position + 0.5
    motor.current_saturation = 3.0
    assert settled(motor, steps=400) == pytest.approx(4.0 * 0.5 * 0.1, rel=0.02)
    settled(motor, steps=10_000)
    motor.position = motor.encoder.position - 0.5
    # From full current at 2 A/s it takes 1.5 s to come down to zero: not longer.
    assert settled(motor, steps=round(1.5 / SUBSTEP)) == pytest.approx(0.0, abs=0.01)


def test_stop_keeps_the_alignment_and_switching_off_loses_it(motor):
    motor.current = 1.0
    motor.enable(False)
    assert settled(motor) == pytest.approx(0.0, abs=1e-9)
    motor.enable(True)
    assert settled(motor) == pytest.approx(1.0)
    motor.forget_alignment()
    assert not motor.ready
    assert settled(motor) == pytest.approx(0.0, abs=1e-9)


def test_reported_voltage_gives_joule_loss_plus_mechanical_power(motor):
    motor.current = 2.0
    for step in range(2000):
        motor.step(50.0 * step * SUBSTEP)
    current, speed = motor.measured_current, motor.encoder.velocity
    power = 1.5 * motor.quadrature_voltage * current  # (4.1)
    joule, mechanical = 1.5 * 0.15 * current**2, MOTOR.torque_constant * current * speed
    assert power == pytest.approx(joule + mechanical)
    assert motor.power == pytest.approx(power)


WARM = MotorConfig('MN4006', 12, 380.0, 16.0, 1.3e-5, 0.15, thermal=ThermalConfig(6.0))


def test_a_motor_as_stated_ends_at_its_largest_temperature_under_its_continuous_current():
    heat = EmulatedHeat(WARM)
    for _ in range(3000):
        heat.step(6.0**2, 0.0, 1.0)
    assert heat.copper == pytest.approx(110.0, abs=0.5)
    copper, iron, housing = heat.temperatures
    assert copper > iron > housing > ROOM


def test_the_heat_that_flows_in_is_stored_or_flows_out():
    """Whatever the step: the integration is stable, and its energy balance closes."""
    fine, coarse = EmulatedHeat(WARM, 3), EmulatedHeat(WARM, 3)
    for _ in range(4000):
        fine.step(9.0**2, 0.0, 0.01)
    coarse.step(9.0**2, 0.0, 40.0)
    assert coarse.temperatures == pytest.approx(fine.temperatures, abs=0.3)


def test_iron_warms_a_motor_that_turns_without_current():
    heat = EmulatedHeat(WARM)
    heat.step(0.0, 150.0, 60.0)
    assert heat.temperatures[1] > ROOM + 1.0
