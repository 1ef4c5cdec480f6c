"""Faults of an IMU that a single sample does not show."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.imu_sample import ImuSample
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError

Array = npt.NDArray[np.float64]

# A drone in flight shakes: the last digits of two samples differ.
_FROZEN = 0.1  # [s]
_FORCE_MAX = 50.0  # [m/s^2]; in flight nothing but the rotors is felt
# What rotors and arm do to a drone within a step, and the share of noise; steps above count alike.
_FORCE_JUMP, _FORCE_SLOPE = 12.0, 1000.0  # [m/s^2], [m/s^3]
_RATE_JUMP, _RATE_SLOPE = 0.4, 100.0  # [rad/s], [rad/s^2]
_STEP_MAX = 0.01  # [s]
_GAP = 0.1  # [s] samples further apart are not neighbours
# How far attitude and gyroscope may differ over some time; what is cut is a filter that was reset.
_TURN_TIME, _TURN_ERROR, _TURN_CUT = 0.2, 1.0, 20.0  # [s], [rad/s], [rad/s]


class ImuWatch:
    """Compares samples with the ones before.

    A reading that jumps is refused for as long as it stays there: only `forget` makes it
    believable, once nothing depends on it any more.
    """

    def __init__(self) -> None:
        self._previous: ImuSample | None = None  # taken or not
        self._changed = {'acceleration': -np.inf, 'angular velocity': -np.inf}
        self._turn_error = np.zeros(3)
        self.forget()

    def forget(self) -> None:
        """Compare the next sample with none taken before."""
        self._taken: ImuSample | None = None

    def check(self, sample: ImuSample) -> None:
        """Take a sample if it is plausible.

        Raises
        ------
        RejectedInputError
            If it repeats what came before for too long, jumps away from the last one taken, turns
            otherwise than its attitude, or is of no drone in flight.
        """
        previous, self._previous = self._previous, sample
        step = np.inf if previous is None else sample.stamp - previous.stamp
        if previous is not None and 0.0 < step < _GAP:
            self._refuse_frozen(previous, sample)
            self._refuse_turn(previous, sample, step)
        else:
            self._changed = dict.fromkeys(self._changed, sample.stamp)
            self._turn_error = np.zeros(3)
        felt = float(np.linalg.norm(sample.specific_force))
        if felt > _FORCE_MAX:
            raise RejectedInputError(
                f'IMU: an acceleration of {felt:.0f} m/s^2, which rotors cannot bring about: check '
                'its mount and driver'
            )
        if self._taken is not None:
            _refuse_jump(self._taken, sample, min(max(step, 0.0), _STEP_MAX))
        self._taken = sample

    def _refuse_frozen(self, previous: ImuSample, sample: ImuSample) -> None:
        for what, before, now in (
            ('acceleration', previous.specific_force, sample.specific_force),
            ('angular velocity', previous.angular_velocity, sample.angular_velocity),
        ):
            if np.any(now != before):
                self._changed[what] = sample.stamp
        what = min(self._changed, key=self._changed.__getitem__)
        since = sample.stamp - self._changed[what]
        if since > _FROZEN:
            raise RejectedInputError(
                f'IMU: its {what} is frozen, the same numbers for {since:.1f} s: check the driver'
            )

    def _refuse_turn(self, previous: ImuSample, sample: ImuSample, step: float) -> None:
        if previous.attitude is None or sample.attitude is None:
            return
        turn = _turn(previous.attitude, sample.attitude) / step
        error = turn - 0.5 * (previous.angular_velocity + sample.angular_velocity)
        error = np.minimum(np.maximum(error, -_TURN_CUT), _TURN_CUT)
        share = step / (_TURN_TIME + step)
        self._turn_error = self._turn_error + share * (error - self._turn_error)
        size = float(np.linalg.norm(self._turn_error))
        if size > _TURN_ERROR:
            raise RejectedInputError(
                f'IMU: its angular velocity is {size:.1f} rad/s off that with which its attitude '
                'turns: check the driver, and that both are in the same axes'
            )


def _turn(before: Array, after: Array) -> Array:
    """Return the small turn (3,) [rad], in the IMU's axes, from one quaternion to another."""
    # Twice the vector of the product conj(before) after: numpy's cross costs ten times as much.
    (a, b, c, d), (x, y, z, w) = before.tolist(), after.tolist()
    sign = np.copysign(2.0, a * x + b * y + c * z + d * w)
    turn = (
        d * x - w * a - b * z + c * y,
        d * y - w * b - c * x + a * z,
        d * z - w * c - a * y + b * x,
    )
    return np.array([sign * part for part in turn])


def _refuse_jump(taken: ImuSample, sample: ImuSample, step: float) -> None:
    force = sample.specific_force - taken.specific_force
    rate = sample.angular_velocity - taken.angular_velocity
    for what, change, limit, unit in (
        ('angular velocity', rate, _RATE_JUMP + _RATE_SLOPE * step, 'rad/s'),
        ('acceleration', force, _FORCE_JUMP + _FORCE_SLOPE * step, 'm/s^2'),
    ):
        size = float(np.abs(change).max())
        if size > limit:
            raise RejectedInputError(
                f'IMU: its {what} jumps by {size:.2g} {unit} from one sample to the next: check '
                'cable and driver'
            )
