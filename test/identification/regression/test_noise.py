"""Noise level and independent samples, from processes whose values are known."""

import numpy as np
import pytest

from aerarm_ros.identification.regression.base_parameters import noise_from_residuals


def autoregressive(rho: float, count: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    shocks = np.sqrt(1.0 - rho**2) * random.standard_normal(count)
    values = np.empty(count)
    values[0] = random.standard_normal()
    for k in range(1, count):
        values[k] = rho * values[k - 1] + shocks[k]
    return values


@pytest.mark.parametrize('rho', [0.0, 0.5, 0.9])
def test_correlation_time_of_an_autoregressive_process(rho: float) -> None:
    """Its integrated autocorrelation time is (1 + rho) / (1 - rho)."""
    residuals = [0.3 * autoregressive(rho, 20_000, seed)[:, None] for seed in range(2)]
    usable = [np.ones((20_000, 1), dtype=bool)] * 2
    noise = noise_from_residuals(residuals, usable, np.ones(1))
    assert noise.std[0] == pytest.approx(0.3, rel=0.05)
    assert noise.correlation[0] == pytest.approx((1 + rho) / (1 - rho), rel=0.25)
    assert noise.information_weights[0] == pytest.approx(
        1.0 / (noise.std[0] * np.sqrt(noise.correlation[0]))
    )


def test_unusable_rows_do_not_count() -> None:
    residual = np.random.default_rng(0).standard_normal((1000, 2))
    usable = np.ones((1000, 2), dtype=bool)
    residual[:500, 1], usable[:500, 1] = 1e3, False
    noise = noise_from_residuals([residual], [usable], np.ones(2))
    assert noise.std == pytest.approx([1.0, 1.0], rel=0.1)


def test_weights_stay_finite_without_noise_or_samples() -> None:
    usable = np.array([[True, False]] * 50)
    noise = noise_from_residuals([np.zeros((50, 2))], [usable], np.array([2.0, 0.0]))
    assert np.all(np.isfinite(noise.weights))
    assert np.all(noise.correlation == 1.0)
