"""One joint moves at constant velocity, with smooth ramps at both ends."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.settings.excitation_error import ExcitationError
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.smooth_step import PEAK_SLOPE, smooth_step


@dataclass(frozen=True, eq=False)
class SteadyStroke:
    """A stroke of one joint from rest to rest; the other joints stand still.

    Parameters
    ----------
    start : (n,) posture at the beginning [rad].
    joint : index of the joint that moves.
    travel : signed way of that joint [rad].
    speed : constant speed in the middle of the way [rad/s], positive.
    acceleration : largest acceleration of the ramps [rad/s^2], positive.

    Raises
    ------
    ExcitationError
        If the ramps leave no part at constant speed.
    """

    start: FloatArray
    joint: int
    travel: float
    speed: float
    acceleration: float

    def __post_init__(self) -> None:
        if not (self.speed > 0.0 and self.acceleration > 0.0):
            raise ExcitationError('speed and acceleration of a stroke must be positive')
        if self.steady_time <= 0.0:
            raise ExcitationError(
                f'a stroke of {abs(self.travel):.3g} rad is too short for {self.speed:.3g} rad/s: '
                f'its ramps alone take {self.speed * self.ramp_time:.3g} rad'
            )

    @property
    def ramp_time(self) -> float:
        """Duration of each ramp [s]."""
        return PEAK_SLOPE * self.speed / self.acceleration

    @property
    def steady_time(self) -> float:
        """Time at constant speed [s]: a ramp covers half of what that speed would."""
        return abs(self.travel) / self.speed - self.ramp_time

    @property
    def duration(self) -> float:
        """Length of the stroke [s]."""
        return 2.0 * self.ramp_time + self.steady_time

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,), held at the ends outside."""
        t = np.clip(np.asarray(time, dtype=float), 0.0, self.duration)
        ramp, speed = self.ramp_time, np.copysign(self.speed, self.travel)
        up, down = smooth_step(t / ramp), smooth_step((t - self.duration + ramp) / ramp)
        # The integral of a step goes on at 1/2: the time since the ramp's end is added here.
        steady = np.maximum(t - ramp, 0.0)
        way = ramp * (up.integral - down.integral) + steady
        return JointReference(
            self._of_joint(self.start, speed * way),
            self._of_joint(np.zeros(len(self.start)), speed * (up.value - down.value)),
            self._of_joint(np.zeros(len(self.start)), speed / ramp * (up.slope - down.slope)),
        )

    def _of_joint(self, others: FloatArray, value: ArrayLike) -> FloatArray:
        """Return `others` with `value`, scalar or (M,), added to the joint that moves."""
        value = np.asarray(value)
        whole = np.broadcast_to(others, (*value.shape, len(others))).copy()
        whole[..., self.joint] += value
        return whole
