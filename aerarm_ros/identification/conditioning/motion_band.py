"""The frequencies that a motion occupies."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SHARE = 0.999  # of a velocity's power lies below its band's edge


def motion_band(dq: Array, dt: float) -> float:
    """Return the frequency below which nearly all of a motion lies.

    Parameters
    ----------
    dq : (M, n) ndarray
        Joint velocities [rad/s].
    dt : float
        Sampling time [s].

    Returns
    -------
    float
        [Hz]; the largest of the joints'. White measurement noise is taken off first, at the
        level of the upper half of the spectrum.
    """
    window = np.hanning(len(dq))[:, None]
    power = np.abs(np.fft.rfft((dq - dq.mean(axis=0)) * window, axis=0)) ** 2
    frequency = np.fft.rfftfreq(len(dq), dt)
    noise = np.median(power[len(power) // 2 :], axis=0) / np.log(2.0)
    # Single bins of noise scatter about their mean: only what stands out of it counts.
    signal = np.where(power > 10.0 * noise, power - noise, 0.0)
    total = np.cumsum(signal, axis=0)
    moving = total[-1] > 0.0
    if not moving.any():
        return float(frequency[1])
    edges = [int(np.searchsorted(column, _SHARE * column[-1])) for column in total[:, moving].T]
    return float(max(frequency[max(edges)], frequency[1]))
