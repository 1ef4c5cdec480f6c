"""Quintic step from 0 to 1: the one shape behind every motion from rest to rest.

So go run-in and run-out of an excitation, smooth stops, and ways between two postures.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.motion.float_array import FloatArray

PEAK_SLOPE = 1.875
"""Largest slope of the step, at its middle."""
PEAK_CURVATURE = 10.0 / np.sqrt(3.0)
"""Largest second derivative of the step."""


class SmoothStep(NamedTuple):
    """Step value, its slope, its integral from 0, and its second derivative."""

    value: FloatArray
    slope: FloatArray
    integral: FloatArray
    curvature: FloatArray


def smooth_step(x: ArrayLike) -> SmoothStep:
    """Return the step 10 x^3 - 15 x^4 + 6 x^5 with zero slope and curvature at both ends.

    Outside [0, 1] the value holds at 0 or 1 and the integral goes on at 0 or 1/2: callers add
    the constant-speed part themselves. `x` is a scalar or any array, without unit.
    """
    # Called in the 1 kHz loop, where np.clip would take longer than all the rest.
    u: FloatArray = np.minimum(np.maximum(x, 0.0), 1.0)
    return SmoothStep(
        u**3 * (10.0 - 15.0 * u + 6.0 * u**2),
        30.0 * u**2 * (1.0 - u) ** 2,
        u**4 * (2.5 - 3.0 * u + u**2),
        60.0 * u * (1.0 - u) * (1.0 - 2.0 * u),
    )


def rest_to_rest_duration(
    distance: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike, minimum: float
) -> float:
    """Return the shortest duration [s] of a rest-to-rest quintic within the given peaks.

    Parameters
    ----------
    distance : (n,) signed joint travel [rad].
    velocity, acceleration : (n,) allowed peaks [rad/s], [rad/s^2], positive.
    minimum : shortest duration wanted [s].
    """
    travel = np.abs(np.asarray(distance, dtype=float))
    by_velocity = PEAK_SLOPE * travel / np.asarray(velocity, dtype=float)
    by_acceleration = np.sqrt(PEAK_CURVATURE * travel / np.asarray(acceleration, dtype=float))
    return float(max(minimum, by_velocity.max(), by_acceleration.max()))
