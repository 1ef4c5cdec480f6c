"""Arm motions that disturb the drone."""

from dataclasses import dataclass

import numpy as np
from flying.grown_motion import HANGING, RAMP, GrownMotion
from numpy.typing import ArrayLike

from aerarm_ros.motion.signals import JointReference

MOTIONS = {  # amplitude [rad], frequency [Hz]
    'slow': (np.array([0.4, 0.5, 0.45, 0.5]), np.array([0.2, 0.25, 0.3, 0.35])),
    'fast': (np.array([0.5, 0.8, 0.6, 0.7]), np.array([0.5, 0.6, 0.75, 0.9])),
}


@dataclass(frozen=True, eq=False)
class Sines:
    """Sine motion of each joint about the hanging posture; amplitudes [rad], frequencies [Hz]."""

    amplitude: np.ndarray
    frequency: np.ndarray

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        w = 2.0 * np.pi * self.frequency
        angle = np.multiply.outer(time, w)
        s, c = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        return JointReference(HANGING + s, w * c, -(w**2) * s)


class ArmSwing(GrownMotion):
    """Sine motion of each joint, with ramps from rest and to rest.

    Parameters
    ----------
    motion : str
        Key of `MOTIONS`.
    seconds, ramp : float
        See `GrownMotion`.
    """

    def __init__(self, motion: str, seconds: float, ramp: float = RAMP) -> None:
        super().__init__(Sines(*MOTIONS[motion]), seconds, ramp)
