"""Motion about the hanging posture, with ramps from rest and to rest."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.motion.polynomial_path import smooth_step
from aerarm_ros.motion.signals import JointReference

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
RAMP = 2.0  # [s]


class Course(Protocol):
    """Motion of infinite duration."""

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        ...


class GrownMotion:
    """Displacement of a course from the hanging posture, scaled by a factor that rises and falls.

    Parameters
    ----------
    seconds : float
        Duration including both ramps [s].
    ramp : float
        Duration of each ramp [s].
    """

    def __init__(self, course: Course, seconds: float, ramp: float = RAMP) -> None:
        self.course = course
        self.duration, self.ramp = seconds, ramp

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        times = np.atleast_1d(time)
        here = times[:, None]
        ramp = self.ramp
        rise, fall = smooth_step(here / ramp), smooth_step((self.duration - here) / ramp)
        # At most one of the two factors differs from its final value.
        g = rise.value * fall.value
        dg = (rise.slope - fall.slope) / ramp
        ddg = (rise.curvature + fall.curvature) / ramp**2
        q, dq, ddq = self.course.evaluate(times)
        away = q - HANGING
        return JointReference(
            HANGING + g * away, dg * away + g * dq, ddg * away + 2.0 * dg * dq + g * ddq
        )

    def is_moving(self, times: np.ndarray) -> np.ndarray:
        """Return which times lie between the ramps."""
        return (times > self.ramp) & (times < self.duration - self.ramp)
