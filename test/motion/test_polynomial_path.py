"""Polynomial paths against scipy, their ends and derivatives, and the smooth step."""

import numpy as np
import pytest
from scipy.interpolate import BPoly

from aerarm_ros.motion.polynomial_path import (
    PEAK_CURVATURE,
    PEAK_SLOPE,
    PolynomialPath,
    smooth_step,
)

TIMES = (0.0, 0.5, 1.5, 1.8)


@pytest.fixture
def knots() -> np.ndarray:
    """Return positions, velocities and accelerations at the times, (3, 4, 2)."""
    return np.random.default_rng(0).normal(size=(3, 4, 2))


def test_many_times_agree_with_one_at_a_time(knots) -> None:
    path = PolynomialPath.quintic(TIMES, *knots)
    time = np.concatenate([np.linspace(-0.5, 2.5, 301), TIMES])
    one_by_one = np.array([path.evaluate(t) for t in time])
    np.testing.assert_allclose(path.evaluate(time), one_by_one.swapaxes(0, 1), atol=1e-12)
    assert path.evaluate(np.array([])).q.shape == (0, 2)
    np.testing.assert_array_equal(path.evaluate(1).q, path.evaluate(1.0).q)


def test_agrees_with_scipy(knots) -> None:
    path = PolynomialPath.quintic(TIMES, *knots)
    scipy = BPoly.from_derivatives(TIMES, knots.swapaxes(0, 1))
    time = np.linspace(0.0, 1.8, 101)[:-1]
    for order, rows in enumerate(path.evaluate(time)):
        np.testing.assert_allclose(rows, scipy.derivative(order)(time), atol=1e-9)


def test_holds_before_and_after(knots) -> None:
    path = PolynomialPath.quintic(TIMES, *knots)
    for time, end in ((-1.0, 0), (5.0, -1)):
        reference = path.evaluate(time)
        np.testing.assert_allclose(reference.q, knots[0, end], atol=1e-12)
        assert not reference.dq.any()
        assert not reference.ddq.any()


X = np.linspace(0.0, 1.0, 2001)


def test_the_smooth_step_has_flat_ends_and_the_derivatives_of_its_value() -> None:
    step = smooth_step(X)
    np.testing.assert_allclose(np.gradient(step.value, X)[1:-1], step.slope[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(step.slope, X)[1:-1], step.curvature[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(step.integral, X)[1:-1], step.value[1:-1], atol=1e-5)
    assert abs(step.slope.max() - PEAK_SLOPE) < 1e-6
    assert abs(np.abs(np.gradient(step.slope, X)).max() - PEAK_CURVATURE) < 1e-3
    assert smooth_step(-1.0) == (0.0, 0.0, 0.0, 0.0)
    assert smooth_step(2.0) == (1.0, 0.0, 0.5, 0.0)
