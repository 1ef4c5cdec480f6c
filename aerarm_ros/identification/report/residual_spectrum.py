"""Spectra of torques: what a model leaves unexplained, and at which frequencies."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SEGMENTS = 4  # a motion's length holds this many, the overlapping ones not counted


def amplitude_density(values: Array, dt: float) -> tuple[Array, Array]:
    """Return frequencies and amplitude spectral density, averaged over segments (Welch).

    Parameters
    ----------
    values : (M,) ndarray
        Evenly sampled; M at least 8.
    dt : float
        [s]

    Returns
    -------
    frequency, density : (K,) ndarray
        [Hz], and the values' unit over the root of Hz: the squares' integral is the variance.
    """
    length = max(8, len(values) // _SEGMENTS)
    starts = range(0, len(values) - length + 1, max(1, length // 2))
    window = np.hanning(length + 1)[:length]
    segments = np.array([values[start : start + length] for start in starts])
    segments = (segments - values.mean()) * window
    power = (np.abs(np.fft.rfft(segments, axis=1)) ** 2).mean(axis=0)
    power *= 2.0 * dt / float(window @ window)
    return np.asarray(np.fft.rfftfreq(length, dt)), np.asarray(np.sqrt(power))
