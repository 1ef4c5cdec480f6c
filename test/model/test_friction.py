"""Friction opposes motion."""

import numpy as np

from aerarm_ros.model.regressor import viscous_coulomb

FV, FS = np.array([0.1, 0.2]), np.array([0.5, 0.3])


def test_values_of_the_law() -> None:
    dq = np.array([[2.0, -1.0], [0.0, 0.5]])
    assert np.allclose(viscous_coulomb(dq, FV, FS), [[0.7, -0.5], [0.0, 0.4]])


def test_friction_never_drives(rng: np.random.Generator) -> None:
    dq = rng.normal(size=(100, 2))
    torque = viscous_coulomb(dq, FV, FS)
    assert np.all(torque * dq > 0.0)
    assert np.all(np.abs(torque) <= np.abs(FV * dq) + FS)
