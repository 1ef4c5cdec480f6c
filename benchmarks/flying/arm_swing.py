"""The motions of the arm that a drone has to bear."""

import numpy as np

from aerarm_ros.motion.smooth_step import smooth_step

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
MOTIONS = {  # amplitude [rad], frequency [Hz]
    'slow': (np.array([0.4, 0.5, 0.45, 0.5]), np.array([0.2, 0.25, 0.3, 0.35])),
    'fast': (np.array([0.5, 0.8, 0.6, 0.7]), np.array([0.5, 0.6, 0.75, 0.9])),
}
RAMP = 2.0  # [s]


class ArmSwing:
    """A sine a joint about the hanging posture, grown from rest and back.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    seconds : float
        Its duration [s], both ramps included.
    """

    def __init__(self, motion: str, seconds: float) -> None:
        self.amplitude, self.frequency = MOTIONS[motion]
        self.duration = seconds

    def evaluate(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, dq, ddq, (M, n) each."""
        times = np.atleast_1d(times)[:, None]
        rise, fall = smooth_step(times / RAMP), smooth_step((self.duration - times) / RAMP)
        # Only one of the two is not at its end.
        g = rise.value * fall.value
        dg = (rise.slope - fall.slope) / RAMP
        ddg = (rise.curvature + fall.curvature) / RAMP**2
        w = 2.0 * np.pi * self.frequency
        s, c = np.sin(w * times), np.cos(w * times)
        a = self.amplitude
        return (
            HANGING + a * g * s,
            a * (dg * s + g * w * c),
            a * (ddg * s + 2.0 * dg * w * c - g * w**2 * s),
        )

    def is_moving(self, times: np.ndarray) -> np.ndarray:
        """Return which times lie between the ramps."""
        return (times > RAMP) & (times < self.duration - RAMP)
