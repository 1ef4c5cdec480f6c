"""The frequencies that a motion occupies."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SHARE = 0.999  # of a velocity's power lies below its band's edge


def motion_band(q: Array, dq: Array | None, dt: float) -> float:
    """Return the frequency below which nearly all of a motion lies.

    Parameters
    ----------
    q : (M, n) ndarray
        Joint positions [rad].
    dq : (M, n) ndarray or None
        Measured joint velocities [rad/s]. A joint's motion is in both, noise in one of them: the
        narrower band of the two counts.
    dt : float
        Sampling time [s].

    Returns
    -------
    float
        [Hz]; the largest of the joints'. White measurement noise is taken off first, at the
        level of the upper half of the spectrum.
    """
    frequency = np.asarray(np.fft.rfftfreq(len(q), dt))
    edges = _edges(frequency, q, derivative=1)
    if dq is not None:
        edges = np.minimum(edges, _edges(frequency, dq))
    return float(max(np.max(edges, initial=0.0), frequency[1]))


def position_band(q: Array, dt: float) -> float:
    """Return the frequency [Hz] below which nearly all of the power of positions (M, n) lies.

    Lower than the motion's, since velocity and acceleration grow with frequency, but far above
    noise: no joint moves as little as its encoder's noise.
    """
    frequency = np.asarray(np.fft.rfftfreq(len(q), dt))
    return float(max(np.max(_edges(frequency, q), initial=0.0), frequency[1]))


def _edges(frequency: Array, values: Array, derivative: int = 0) -> Array:
    """Return the (n,) band edges [Hz] of velocities or, by a derivative, of positions."""
    window = np.hanning(len(values))[:, None]
    power = np.abs(np.fft.rfft((values - values.mean(axis=0)) * window, axis=0)) ** 2
    noise = np.median(power[len(power) // 2 :], axis=0) / np.log(2.0)
    # Single bins of noise scatter about their mean: only what stands out of it counts.
    signal = np.where(power > 10.0 * noise, power - noise, 0.0)
    total = np.cumsum(signal * frequency[:, None] ** (2 * derivative), axis=0)
    edges = [np.searchsorted(column, _SHARE * column[-1]) for column in total.T]
    return np.asarray(frequency[edges])
