"""How large the torque's errors are, and how many of its samples are independent."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SMALLEST_SHARE = 1e-6  # of a joint's torque: keeps weights finite on data without noise


@dataclass(frozen=True, eq=False)
class Noise:
    """Residual torque of each joint.

    Attributes
    ----------
    std : (n,) ndarray
        [Nm]
    correlation : (n,) ndarray
        Samples that carry the information of one independent sample, at least 1. Filtering
        and model errors both correlate neighbouring residuals; taking them as independent
        would make standard deviations too small.
    """

    std: Array
    correlation: Array

    @property
    def weights(self) -> Array:
        """(n,) factors of the joints' rows for a fit [1/Nm].

        One over the noise; the correlation common to all joints lowers the data's weight
        against the prior's. A joint's own correlation is no reason to trust it less than
        its noise says.
        """
        return np.asarray(1.0 / (self.std * np.sqrt(np.median(self.correlation))))

    @property
    def information_weights(self) -> Array:
        """(n,) factors that give unit variance an independent sample, for covariances [1/Nm]."""
        return np.asarray(1.0 / (self.std * np.sqrt(self.correlation)))


def noise_from_residuals(
    residuals: Sequence[Array], usable: Sequence[npt.NDArray[np.bool_]], torque_rms: Array
) -> Noise:
    """Measure the noise.

    Parameters
    ----------
    residuals : sequence of (M, n) arrays
        Measured minus predicted torque of each bag [Nm].
    usable : sequence of (M, n) bool arrays
        Which of these count.
    torque_rms : (n,) ndarray
        Size of each joint's torque [Nm].
    """
    n = len(torque_rms)
    std, correlation = np.empty(n), np.ones(n)
    for joint in range(n):
        kept = [r[u[:, joint], joint] for r, u in zip(residuals, usable, strict=True)]
        count = sum(len(part) for part in kept)
        power = sum(float(part @ part) for part in kept)
        floor = _SMALLEST_SHARE * max(float(torque_rms[joint]), 1e-6)
        std[joint] = max(np.sqrt(power / max(count, 1)), floor)
        if count and power / count > floor**2:
            times = [_correlation_time(part) * len(part) for part in kept if len(part) > 3]
            correlation[joint] = max(1.0, sum(times) / count)
    return Noise(std, correlation)


def _correlation_time(residual: Array) -> float:
    """Return the integrated autocorrelation time [samples], summed to five times itself.

    The window is Sokal's: a longer sum would add noise, a shorter one cut correlation off.
    """
    padded = np.fft.rfft(residual, 2 * len(residual))
    covariance = np.fft.irfft(np.abs(padded) ** 2)[: len(residual)]
    if covariance[0] <= 0.0:
        return 1.0
    total = 2.0 * np.cumsum(covariance / covariance[0]) - 1.0
    inside = np.arange(len(total)) < 5.0 * total
    last = int(np.argmin(inside)) if not inside.all() else len(total) - 1
    return float(max(total[last], 1.0))
