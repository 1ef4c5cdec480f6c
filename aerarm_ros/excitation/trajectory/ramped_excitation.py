"""A whole number of periods of a Fourier trajectory, entered from rest and left to rest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.excitation.trajectory.fourier_trajectory import FourierTrajectory
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.smooth_step import smooth_step


@dataclass(frozen=True, eq=False)
class RampedExcitation:
    """Fourier trajectory traversed at a speed that rises from 0 to 1 and falls back to 0.

    A Fourier trajectory starts with velocity and acceleration. Rather than reaching them by a
    polynomial, which swings out by a distance that grows with the start velocity, the arm
    enters on the trajectory itself: the phase phi(t) starts half a ramp before zero and its
    rate rises along a quintic step, so posture, velocity and acceleration are continuous. The
    postures of run-in and run-out are then postures of the trajectory, already checked, and
    their velocities never exceed the trajectory's.

    Parameters
    ----------
    trajectory : the periodic part.
    periods : how many whole periods are traversed at full speed, at least 1.
    ramp_time : duration of each ramp [s], positive.

    Raises
    ------
    ExcitationError
        If periods is not a positive integer or the ramp time is not positive.
    """

    trajectory: FourierTrajectory
    periods: int
    ramp_time: float

    def __post_init__(self) -> None:
        if self.periods < 1 or self.periods != int(self.periods):
            raise ExcitationError(
                f'the number of periods must be a positive integer, got {self.periods}'
            )
        if not (np.isfinite(self.ramp_time) and self.ramp_time > 0.0):
            raise ExcitationError(f'ramp time must be positive, got {self.ramp_time} s')

    @property
    def duration(self) -> float:
        """Length with both ramps [s]."""
        return self.periodic_duration + 2.0 * self.ramp_time

    @property
    def periodic_duration(self) -> float:
        """Length of the part at full speed [s], a whole number of periods."""
        return self.periods * self.trajectory.period

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,); at rest outside the duration."""
        ramp, length = self.ramp_time, self.periodic_duration
        if np.ndim(time) == 0 and ramp <= time <= ramp + length:  # type: ignore[operator]
            return self.trajectory.evaluate(time - ramp)  # type: ignore[operator]
        time = np.asarray(time, dtype=float)
        after_up = time - ramp
        up, down = smooth_step(time / ramp), smooth_step((after_up - length) / ramp)
        # The phase is the integral of the rate: up.value at first, then 1, then 1 - down.value.
        phase = ramp * (up.integral - down.integral - 0.5) + np.minimum(
            np.maximum(after_up, 0.0), length + ramp
        )
        rate = (up.value - down.value)[..., np.newaxis]
        rate_change = ((up.slope - down.slope) / ramp)[..., np.newaxis]
        return self.trajectory.evaluate(phase).paced(rate, rate_change)
