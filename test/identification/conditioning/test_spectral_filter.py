"""Zero-phase filtering: against SciPy, exact derivatives, decimation, ends."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from aerarm_ros.identification.conditioning.spectral_filter import (
    MEMORY_PERIODS,
    SpectralFilter,
    harmonic_gain,
    low_pass_gain,
)

DT = 2e-3


def noise(count: int, columns: int = 3) -> np.ndarray:
    return np.random.default_rng(0).standard_normal((count, columns))


def test_the_low_pass_is_a_butterworth_filter_applied_forwards_and_backwards() -> None:
    """Far below the Nyquist frequency the digital design equals the analogue one."""
    signal = np.cumsum(noise(4000), axis=0) * 0.05
    expected = sosfiltfilt(butter(4, 5.0, fs=1.0 / DT, output='sos'), signal, axis=0)
    smooth = SpectralFilter(4000, DT, low_pass_gain(5.0), settling=0.8)(signal)
    inner = slice(300, -300)
    assert np.abs(smooth - expected)[inner].max() < 2e-3 * np.abs(signal).max()


@pytest.mark.parametrize('derivative', [0, 1, 2])
def test_derivatives_of_a_periodic_signal_are_exact(derivative: int) -> None:
    count, omega = 1000, 2 * np.pi / (1000 * DT)
    t = DT * np.arange(count)
    signal = np.sin(3 * omega * t) + 2.0
    smooth = SpectralFilter(count, DT, harmonic_gain(omega / (2 * np.pi), 5))
    exact = [np.sin, np.cos, lambda x: -np.sin(x)][derivative](3 * omega * t)
    exact = exact * (3 * omega) ** derivative + (2.0 if derivative == 0 else 0.0)
    assert np.allclose(smooth(signal, derivative), exact, atol=1e-9 * (3 * omega) ** 2)


def test_rectangular_windows_pass_the_known_harmonics_only() -> None:
    """Section 3.5: of two periods, only constant and multiples of f0 up to N f0 are left."""
    count = 2000
    t = np.arange(count) / 1000.0  # two periods of f0 = 1
    wanted = 1.0 + np.cos(2 * np.pi * t) + np.sin(2 * np.pi * 3 * t)
    unwanted = np.sin(2 * np.pi * 1.5 * t) + np.sin(2 * np.pi * 4 * t)
    smooth = SpectralFilter(count, 1e-3, harmonic_gain(1.0, 3))
    assert np.allclose(smooth(wanted + unwanted), wanted, atol=1e-12)


@pytest.mark.parametrize('count', [7, 20, 97])
def test_short_signals_are_filtered_too(count: int) -> None:
    filtered = SpectralFilter(count, DT, low_pass_gain(20.0), 3, settling=10.0)(noise(count))
    assert filtered.shape == (-(-count // 3), 3)
    assert np.isfinite(filtered).all()


def test_uneven_decimation_of_a_periodic_signal_is_refused() -> None:
    with pytest.raises(ValueError, match='decimated'):
        SpectralFilter(1000, DT, low_pass_gain(5.0), 7)


@pytest.mark.parametrize('derivative', [0, 1])
@pytest.mark.parametrize(('settling', 'decimation'), [(None, 1), (None, 20), (1.2, 20)])
def test_filtering_in_parts_equals_filtering_the_whole_signal(
    settling: float | None, decimation: int, derivative: int
) -> None:
    count, cutoff = 200_000, 5.0
    signal = np.cumsum(noise(count, 2), axis=0)
    signal -= signal[0] + np.outer(np.arange(count), signal[-1] - signal[0]) / count
    how = (count, DT, low_pass_gain(cutoff), decimation, settling)
    whole = SpectralFilter(*how)(signal, derivative)
    parts = SpectralFilter(*how, memory=MEMORY_PERIODS / cutoff)(signal, derivative)
    # Decimation cuts the spectrum off where its gain is still 7e-4, so its response lasts longer.
    tolerance = 1e-9 if decimation == 1 else (2e-6, 5e-5)[derivative]
    assert np.abs(parts - whole).max() < tolerance * np.abs(whole).max()
