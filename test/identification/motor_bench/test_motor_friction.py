"""Least squares (4.14) finds friction, and voltages the resistance."""

from dataclasses import replace

import numpy as np
import pytest
from motor_data import COULOMB, GRAVITY, LOAD, VISCOUS, step, steps, swings

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_backlash import (
    fit_backlash,
    is_largest,
    is_significant,
)
from aerarm_ros.identification.motor_bench.motor_friction import (
    BOARD,
    VOLTAGE,
    MotorFriction,
    MotorResistance,
    MotorRun,
    MotorSupply,
    find_resistance,
    fit_motor_friction,
)

BARE = {'gravity': np.zeros(2), 'load': 0.0}


def test_bare_motor_as_in_the_thesis() -> None:
    friction = fit_motor_friction(steps(noise=0.05, **BARE), mounted=False, name='j')
    assert abs(friction.viscous - VISCOUS) < 4.0 * friction.std[0] < 0.003
    assert abs(friction.coulomb - COULOMB) < 4.0 * friction.std[1] < 0.004
    assert friction.load == 0.0
    np.testing.assert_array_equal(friction.gravity, 0.0)
    # The points of figure 4.4 lie on the line.
    line = friction.viscous * friction.speed + friction.coulomb * np.sign(friction.speed)
    np.testing.assert_allclose(friction.torque, line, atol=0.01)


def test_gravity_and_the_friction_it_causes_are_taken_off() -> None:
    friction = fit_motor_friction(steps(noise=0.05), mounted=True, name='j')
    theta = [friction.viscous, friction.coulomb, friction.load, *friction.gravity]
    wanted = np.array([VISCOUS, COULOMB, LOAD, *GRAVITY])
    assert np.all(np.abs(theta - wanted) < 4.0 * friction.std)
    np.testing.assert_allclose(
        friction.gravity_torque(np.array([0.5])), [GRAVITY @ [np.sin(0.5), np.cos(0.5)]], atol=0.01
    )


def test_without_gravity_the_load_stays_at_its_prior() -> None:
    friction = fit_motor_friction(steps(noise=0.05, **BARE), mounted=True, name='j')
    assert friction.load == pytest.approx(0.0, abs=0.05)
    assert friction.std[2] == pytest.approx(0.05, rel=0.05)
    assert friction.coulomb == pytest.approx(COULOMB, abs=0.005)


def test_faulty_runs_are_named() -> None:
    with pytest.raises(IdentificationError, match='elbow: only 0 intervals'):
        fit_motor_friction([], mounted=True, name='elbow')
    with pytest.raises(IdentificationError, match='the same direction'):
        fit_motor_friction([step(0.3), step(0.5)], mounted=False, name='elbow')
    stuck = [replace(run, dq=0.0 * run.dq) for run in steps()]
    with pytest.raises(IdentificationError, match='does not reach 0.2 rad/s'):
        fit_motor_friction(stuck, mounted=False, name='elbow')
    backwards = [replace(run, tau=-run.tau) for run in steps(**BARE)]
    with pytest.raises(IdentificationError, match='sign of the motor'):
        fit_motor_friction(backwards, mounted=False, name='elbow')


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


# As of `swings`.
ROTOR, LINKS = 0.0095, 0.004
SWING_COULOMB, SWING_GRAVITY = 0.1, (0.1, -0.02)


def found(run: MotorRun, gravity: tuple[float, float] = SWING_GRAVITY) -> tuple[float, float]:
    """Return what is found by who takes the links for lighter and the rotor for heavier."""
    nothing = np.zeros(0)
    friction = MotorFriction(
        VISCOUS, SWING_COULOMB, LOAD, np.array(gravity), np.zeros((5, 5)), nothing, nothing
    )
    links, rotor = 0.8 * LINKS, 1.2 * ROTOR
    return fit_backlash([run], friction, (links, 0.2 * links), (rotor, 0.3 * rotor), 'joint')


def test_the_backlash_is_estimated_within_a_tenth() -> None:
    value, std = found(swings(0.02))
    assert value == pytest.approx(0.02, rel=0.1)
    assert abs(value - 0.02) < 3.0 * std < 0.008
    assert not is_largest((value, std))


def test_a_gear_without_backlash_yields_none() -> None:
    value, std = found(swings(0.0))
    assert not is_significant((value, std))
    assert value + 3.0 * std < 3e-3


def test_a_backlash_above_the_search_range_is_reported() -> None:
    assert is_largest(found(swings(0.14, seconds=1.2)))


def test_swings_that_are_too_short_are_refused() -> None:
    with pytest.raises(IdentificationError, match='joint: the oscillations are shorter than 0.5 s'):
        found(swings(0.02, seconds=0.4))
