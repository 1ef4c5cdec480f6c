"""Resistance of a motor that is known. On emulated boards: see test_motor_bench.py."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.motor_bench.motor_friction import (
    BOARD,
    VOLTAGE,
    MotorResistance,
    MotorSupply,
    find_resistance,
)

OHM, BACK_EMF = 0.15, 0.0145  # [ohm], [V s/rad]
NOISE = 0.02  # [A] of the measured current
COUNT = 2.0**-10  # [V]
NOTHING = np.empty(0)


def supply(scale: float = 1.0) -> MotorSupply:
    """Forth and back at two speeds, against dry friction; both readings as in frames."""
    time = np.arange(0.0, 8.0, 1e-3)
    speed = 30.0 * np.sign(np.sin(np.pi * time)) * np.where(time < 4.0, 1.0, 2.0)
    current = scale * (0.3 * np.sign(speed) + 1e-3 * speed + 0.2 * np.sin(0.7 * time))
    voltage = COUNT * np.round((OHM * current + BACK_EMF * speed) / COUNT)
    measured = current + NOISE * np.random.default_rng(0).standard_normal(len(time))
    return MotorSupply(time, measured, speed, 1.5 * voltage * measured)


def test_power_current_and_speed_tell_it() -> None:
    found = find_resistance(supply(), 0.1)
    assert found is not None
    assert found.source == VOLTAGE
    assert abs(found.ohm - OHM) < 4.0 * found.std
    assert found.std < 0.02 * OHM


def test_without_voltages_the_resistance_is_that_of_the_board() -> None:
    stated = MotorSupply(NOTHING, NOTHING, NOTHING, NOTHING, reported=0.5)
    assert find_resistance(stated, 0.25) == MotorResistance(0.5, 0.125, BOARD)
    assert find_resistance(replace(stated, reported=np.nan), 0.25) is None
    assert find_resistance(stated, 0.4) is None  # nobody trusts it


def test_currents_that_tell_nothing_are_no_measurement() -> None:
    """Among currents no larger than their noise a fit is biased: there is none."""
    assert find_resistance(supply(0.05), 0.1) is None
    moved = supply()
    one_speed = replace(moved, speed=moved.current)  # no telling the two apart
    assert find_resistance(one_speed, 0.1) is None
    random = np.random.default_rng(1)
    noise = replace(moved, power=random.standard_normal(len(moved.time)), reported=0.5)
    assert find_resistance(noise, 0.25) == MotorResistance(0.5, 0.125, BOARD)


@pytest.mark.parametrize('seconds', [0.0, 0.3])
def test_short_readings_yield_no_resistance(seconds: float) -> None:
    full = supply()
    part = full.time < seconds
    fields = (full.time, full.current, full.speed, full.power)
    assert find_resistance(MotorSupply(*(values[part] for values in fields)), 0.1) is None
