"""Ways of an excitation from rest to rest."""

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.polynomial_path import PolynomialPath


def transfer(start: ArrayLike, end: ArrayLike, duration: float) -> PolynomialPath:
    """Return the quintic from rest at `start` (n,) [rad] to rest at `end` (n,) [rad].

    Raises
    ------
    ExcitationError
        If the duration [s] is not positive or a posture is not finite.
    """
    if not (np.isfinite(duration) and duration > 0.0):
        raise ExcitationError(f'duration of a transfer must be positive, got {duration} s')
    ends = np.array([start, end], dtype=float)
    if not np.isfinite(ends).all():
        raise ExcitationError('the postures of a transfer must be finite numbers')
    return PolynomialPath.rest_to_rest(ends[0], ends[1], duration)


def standstill(position: ArrayLike) -> PolynomialPath:
    """Return one control cycle of rest at `position` (n,) [rad]."""
    return transfer(position, position, 1e-3)
