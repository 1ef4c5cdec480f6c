"""Friction opposes motion, and the smooth law approaches (2.6)."""

import numpy as np
import pytest

from aerarm_ros.model.friction import smooth_viscous_coulomb, viscous_coulomb

FV, FS = np.array([0.1, 0.2]), np.array([0.5, 0.3])


def test_values_of_the_law() -> None:
    dq = np.array([[2.0, -1.0], [0.0, 0.5]])
    assert np.allclose(viscous_coulomb(dq, FV, FS), [[0.7, -0.5], [0.0, 0.4]])


@pytest.mark.parametrize('smooth', [False, True])
def test_friction_never_drives(smooth: bool, rng: np.random.Generator) -> None:
    dq = rng.normal(size=(100, 2))
    torque = smooth_viscous_coulomb(dq, FV, FS, 0.05) if smooth else viscous_coulomb(dq, FV, FS)
    assert np.all(torque * dq > 0.0)
    assert np.all(np.abs(torque) <= np.abs(FV * dq) + FS)


def test_the_smooth_law_is_the_step_away_from_rest_and_steady_at_rest() -> None:
    width = 0.02
    for speed in (-1.0, 1.0):
        dq = np.full(2, 10 * width * speed)
        smooth = smooth_viscous_coulomb(dq, FV, FS, width)
        assert np.allclose(smooth, viscous_coulomb(dq, FV, FS), atol=1e-8)
    step = np.diff(smooth_viscous_coulomb(np.array([[-1e-6], [1e-6]]), FV, FS, width), axis=0)
    assert np.all(np.abs(step) < 1e-4)


@pytest.mark.parametrize('width', [0.0, -0.1, np.nan])
def test_a_width_that_is_not_positive_is_refused(width: float) -> None:
    with pytest.raises(ValueError, match='width'):
        smooth_viscous_coulomb(np.zeros(2), FV, FS, width)
