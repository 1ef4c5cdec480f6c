"""Damped least-squares inverse of a Jacobian."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.gains import positive

Array = npt.NDArray[np.float64]


class DampedInverse:
    """Pseudo-inverse that stays bounded where the Jacobian loses rank.

    Each singular value s is inverted as `s / (s^2 + d^2)`, with a damping that grows from
    zero at `threshold` to `damping` at s = 0::

        d^2 = damping^2 (1 - (s / threshold)^2)

    (Nakamura and Hanafusa 1986, with the damping of Chiaverini, Siciliano, Egeland 1994
    applied per direction: what isn't singular is still followed exactly.)

    Parameters
    ----------
    threshold : float
        Singular value [m/rad] below which a direction is damped.
    damping : float
        [m/rad]; below `threshold / sqrt(2)` the inverse is never larger than
        `1 / (sqrt(2) damping)`, beyond it never larger than `1 / threshold`.

    Raises
    ------
    ValueError
        If one isn't positive.
    """

    class InvertedJacobian(NamedTuple):
        """Inverse (n, m), projector into the null space (n, n), least singular value."""

        inverse: Array
        null_space: Array
        least: float

    def __init__(self, threshold: float = 0.03, damping: float = 0.02) -> None:
        self._threshold = positive('threshold', threshold)
        self._damping = positive('damping', damping)

    def of(self, jacobian: Array) -> InvertedJacobian:
        """Invert a Jacobian (m, n), m <= n."""
        left, values, right = np.linalg.svd(jacobian, full_matrices=False)
        scaled = np.minimum(values / self._threshold, 1.0)
        damping = self._damping**2 * (1.0 - scaled * scaled)
        gains = values / (values * values + damping)
        inverse = (right.T * gains) @ left.T
        null_space = np.eye(jacobian.shape[1]) - (right.T * (gains * values)) @ right
        return self.InvertedJacobian(inverse, null_space, float(values[-1]))
