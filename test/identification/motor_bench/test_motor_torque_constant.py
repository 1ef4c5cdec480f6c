"""A known mass against the current that it takes to hold it."""

import numpy as np
import pytest
from motor_data import GRAVITY, steps

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.motor_bench.motor_bench import fit_torque_constant
from aerarm_ros.identification.motor_bench.motor_friction import fit_motor_friction

MASS = np.array([0.3, 1.5])  # what it adds to a and b [Nm]


def friction_with(added: np.ndarray):
    runs = steps(noise=0.05, gravity=GRAVITY + added)
    return fit_motor_friction(runs, mounted=True, name='j')


def test_true_over_stated_constant() -> None:
    # A motor 4 % stronger than stated needs 4 % less current: the torque seems smaller.
    ratio, std = fit_torque_constant(friction_with(MASS / 1.04), GRAVITY, MASS, 'j')
    assert ratio == pytest.approx(1.04, abs=4.0 * std + 2e-3)
    assert 0.0 < std < 0.01


def test_bare_motor_needs_no_angle_of_the_lever() -> None:
    friction = fit_motor_friction(steps(noise=0.05, gravity=MASS / 0.97), mounted=True, name='j')
    ratio, _ = fit_torque_constant(friction, None, float(np.linalg.norm(MASS)), 'j')
    assert ratio == pytest.approx(0.97, rel=5e-3)


def test_unmeasurable_torque_constants_raise_an_error() -> None:
    friction = friction_with(np.zeros(2))
    with pytest.raises(IdentificationError, match='elbow: the known mass causes at most 0 Nm'):
        fit_torque_constant(friction, GRAVITY, np.zeros(2), 'elbow')
    with pytest.raises(IdentificationError, match='adds .* Nm instead of the expected 1.53 Nm'):
        fit_torque_constant(friction, GRAVITY, MASS, 'elbow')
