"""The step's derivatives, ends and peaks."""

import numpy as np

from aerarm_ros.motion.polynomial_path import PEAK_CURVATURE, PEAK_SLOPE, smooth_step

X = np.linspace(0.0, 1.0, 2001)


def test_slope_and_integral_belong_to_the_value() -> None:
    step = smooth_step(X)
    np.testing.assert_allclose(np.gradient(step.value, X)[1:-1], step.slope[1:-1], atol=1e-5)
    np.testing.assert_allclose(np.gradient(step.slope, X)[1:-1], step.curvature[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(step.integral, X)[1:-1], step.value[1:-1], atol=1e-5)


def test_ends_are_flat_and_half_the_time_is_lost() -> None:
    assert smooth_step(-1.0) == (0.0, 0.0, 0.0, 0.0)
    assert smooth_step(2.0) == (1.0, 0.0, 0.5, 0.0)


def test_peaks() -> None:
    slope = smooth_step(X).slope
    assert abs(slope.max() - PEAK_SLOPE) < 1e-6
    assert abs(np.abs(np.gradient(slope, X)).max() - PEAK_CURVATURE) < 1e-3
