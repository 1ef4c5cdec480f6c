"""Spectra keep power and show where it lies."""

import numpy as np
import pytest

from aerarm_ros.identification.report.report_figures import amplitude_density


def test_the_squares_integrate_to_the_variance() -> None:
    noise = 0.3 * np.random.default_rng(0).standard_normal(4096)
    frequency, density = amplitude_density(noise, 0.01)
    assert frequency[-1] == pytest.approx(50.0)
    assert np.sum(density**2) * frequency[1] == pytest.approx(0.09, rel=0.1)


def test_a_tone_stands_out_at_its_frequency() -> None:
    time = 0.01 * np.arange(4000)
    frequency, density = amplitude_density(5.0 + np.sin(2 * np.pi * 7.0 * time), 0.01)
    assert frequency[density.argmax()] == pytest.approx(7.0, abs=frequency[1])
    assert density[0] < 1e-2 * density.max()
