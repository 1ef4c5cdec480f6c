"""Quintic step from 0 to 1: the one shape behind run-in, run-out and smooth stops."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.joint_reference import FloatArray

PEAK_SLOPE = 1.875
"""Largest slope of the step, at its middle."""
PEAK_CURVATURE = 10.0 / np.sqrt(3.0)
"""Largest second derivative of the step."""


class SmoothStep(NamedTuple):
    """Step value, its slope and its integral from 0."""

    value: FloatArray
    slope: FloatArray
    integral: FloatArray


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
    )
