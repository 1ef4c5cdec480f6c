"""Least squares (4.14) finds what made the torque, and says what it cannot find."""

from dataclasses import replace

import numpy as np
import pytest
from motor_data import COULOMB, GRAVITY, INERTIA, LOAD, VISCOUS, step, steps

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_friction import fit_motor_friction

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


def test_a_velocity_loop_that_still_settles_does_no_harm() -> None:
    runs = steps(settling=0.1, **BARE)
    naive = fit_motor_friction(runs, mounted=False, name='j')
    informed = fit_motor_friction(runs, mounted=False, name='j', inertia=INERTIA)
    assert abs(informed.viscous - VISCOUS) < 1e-5
    assert abs(naive.viscous - VISCOUS) > 1e-4


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
