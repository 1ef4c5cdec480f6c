"""Faults of an IMU that a single sample does not show."""

import numpy as np

from aerarm_ros.control.base.imu_sample import ImuSample
from aerarm_ros.control.checks.rejected_input_error import RejectedInputError

# A drone in flight shakes: the last digits of two samples differ.
_FROZEN = 0.1  # [s]
# Beyond what rotors do to a drone with an arm within a sample.
_FORCE_JUMP = 40.0  # [m/s^2]
_FORCE_MAX = 50.0  # [m/s^2]; in flight nothing but the rotors is felt
_RATE_JUMP = 4.0  # [rad/s]
_BELIEVED = 0.1  # [s] after as long without another sample, the next is believed again


class ImuWatch:
    """Compares samples with the ones before."""

    def __init__(self) -> None:
        self._last: ImuSample | None = None
        self._changed = -np.inf

    def check(self, sample: ImuSample) -> None:
        """Take a sample if it is plausible.

        Raises
        ------
        RejectedInputError
            If it repeats what came before for too long, jumps away from the last one taken, or is
            of no drone in flight.
        """
        last = self._last
        felt = float(np.linalg.norm(sample.specific_force))
        if felt > _FORCE_MAX:
            raise RejectedInputError(
                f'IMU: an acceleration of {felt:.0f} m/s^2, which rotors cannot bring about: check '
                'its mount and driver'
            )
        if last is None or not 0.0 <= sample.stamp - last.stamp < _BELIEVED:
            self._last, self._changed = sample, sample.stamp
            return
        force, rate = sample.specific_force, sample.angular_velocity
        if np.any(force != last.specific_force) or np.any(rate != last.angular_velocity):
            self._changed = sample.stamp
        elif sample.stamp - self._changed > _FROZEN:
            self._last = sample
            raise RejectedInputError(
                f'IMU: frozen, the same numbers for {sample.stamp - self._changed:.1f} s: check '
                'the driver'
            )
        jumps = (
            float(np.max(np.abs(force - last.specific_force))) / _FORCE_JUMP,
            float(np.max(np.abs(rate - last.angular_velocity))) / _RATE_JUMP,
        )
        if max(jumps) > 1.0:
            what = 'acceleration' if jumps[0] > jumps[1] else 'angular velocity'
            raise RejectedInputError(
                f'IMU: its {what} jumps from one sample to the next: check cable and driver'
            )
        self._last = sample
