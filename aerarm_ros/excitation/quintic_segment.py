"""Point-to-point motion with given velocity and acceleration at both ends."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.excitation.excitation_error import ExcitationError
from aerarm_ros.excitation.joint_reference import FloatArray, JointReference
from aerarm_ros.excitation.smooth_step import PEAK_CURVATURE, PEAK_SLOPE


@dataclass(frozen=True, eq=False)
class QuinticSegment:
    """Quintic polynomial of each joint between two boundary states.

    Parameters
    ----------
    start, end : boundary states (position [rad], velocity [rad/s], acceleration [rad/s^2]).
    duration : length [s], positive.

    Raises
    ------
    ExcitationError
        If the duration is not positive or a boundary state is not finite.
    """

    start: JointReference
    end: JointReference
    duration: float
    _coefficients: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if not (np.isfinite(self.duration) and self.duration > 0.0):
            raise ExcitationError(f'duration of a segment must be positive, got {self.duration} s')
        boundary = np.array([*self.start, *self.end], dtype=float)
        if not np.isfinite(boundary).all():
            raise ExcitationError('boundary states of a segment must be finite numbers')
        q_start, v_start, a_start, q_end, v_end, a_end = boundary
        # In x = t / duration, so that the 3 x 3 boundary system is the same for every segment.
        low = np.array([q_start, v_start * self.duration, 0.5 * a_start * self.duration**2])
        remainder = np.array(
            [
                q_end - low.sum(axis=0),
                v_end * self.duration - low[1] - 2.0 * low[2],
                a_end * self.duration**2 - 2.0 * low[2],
            ]
        )
        high = np.linalg.solve([[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]], remainder)
        object.__setattr__(self, '_coefficients', np.concatenate([low, high]))

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], scalar or (M,), held at the ends outside."""
        x = np.clip(np.asarray(time, dtype=float) / self.duration, 0.0, 1.0)
        order = np.arange(6)
        powers = np.power.outer(x, order)
        first = np.zeros_like(powers)
        first[..., 1:] = order[1:] * powers[..., :-1]
        second = np.zeros_like(powers)
        second[..., 2:] = order[2:] * order[1:-1] * powers[..., :-2]
        return JointReference(
            powers @ self._coefficients,
            first @ self._coefficients / self.duration,
            second @ self._coefficients / self.duration**2,
        )


def at_rest(position: ArrayLike) -> JointReference:
    """Return the boundary state at `position` (n,) [rad] without velocity or acceleration."""
    position = np.asarray(position, dtype=float)
    return JointReference(position, np.zeros_like(position), np.zeros_like(position))


def standstill(position: ArrayLike) -> QuinticSegment:
    """Return one control cycle of rest at `position` (n,) [rad]."""
    return QuinticSegment(at_rest(position), at_rest(position), 1e-3)


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
