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


@pytest.mark.parametrize(
    ('runs', 'words'),
    [
        ([], 'elbow: only 0 intervals'),
        ([step(0.3), step(0.5)], 'the same direction'),
        ([replace(run, dq=0.0 * run.dq) for run in steps()], 'does not reach 0.2 rad/s'),
        ([replace(run, tau=-run.tau) for run in steps(**BARE)], 'sign of the motor'),
    ],
)
def test_faulty_runs_are_named(runs: list[MotorRun], words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        fit_motor_friction(runs, mounted=False, name='elbow')


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


def test_voltages_tell_the_resistance_and_else_the_board() -> None:
    """Among currents no larger than their noise a fit is biased: there is none."""
    found = find_resistance(supply(), 0.1)
    assert found is not None
    assert found.source == VOLTAGE
    assert abs(found.ohm - OHM) < 4.0 * found.std < 0.08 * OHM
    stated = MotorSupply(NOTHING, NOTHING, NOTHING, NOTHING, reported=0.5)
    moved, random = supply(), np.random.default_rng(1)
    noise = replace(moved, power=random.standard_normal(len(moved.time)), reported=0.5)
    for measured in (stated, noise):
        assert find_resistance(measured, 0.25) == MotorResistance(0.5, 0.125, BOARD)
    one_speed = replace(moved, speed=moved.current)  # no telling the two apart
    for measured in (replace(stated, reported=np.nan), supply(0.05), one_speed):
        assert find_resistance(measured, 0.1) is None
    assert find_resistance(stated, 0.4) is None  # nobody trusts it


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
    none = found(swings(0.0))
    assert not is_significant(none)
    assert none[0] + 3.0 * none[1] < 3e-3
    assert is_largest(found(swings(0.14, seconds=1.2)))
    with pytest.raises(IdentificationError, match='joint: the oscillations are shorter than 0.5 s'):
        found(swings(0.02, seconds=0.4))
