"""One reading of the drone's inertial measurement unit."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.rejected_input_error import RejectedInputError

Array = npt.NDArray[np.float64]

# Beyond these a unit is wrong rather than a flight bold: 30 g, 6 turns a second.
_SPECIFIC_FORCE_MAX = 300.0
_ANGULAR_VELOCITY_MAX = 40.0


@dataclass(frozen=True, eq=False)
class ImuSample:
    """A checked sample in the IMU's frame, with the conventions of sensor_msgs/Imu.

    Attributes
    ----------
    stamp : float
        [s]
    attitude : (4,) ndarray or None
        Quaternion (x, y, z, w), IMU to a world with z up; None where the IMU has none.
        Normalised when made.
    angular_velocity : (3,) ndarray
        [rad/s]
    specific_force : (3,) ndarray
        Acceleration minus gravity [m/s^2]: about +9.81 along what points up at rest.

    Raises
    ------
    RejectedInputError
        If a number isn't finite, the quaternion is (almost) zero, or a value can't be in
        the unit expected.
    """

    stamp: float
    attitude: Array | None
    angular_velocity: Array
    specific_force: Array

    def __post_init__(self) -> None:
        """Check every number."""
        numbers = [self.stamp, *self.angular_velocity, *self.specific_force]
        if self.attitude is not None:
            numbers += [*self.attitude]
        if not np.all(np.isfinite(numbers)):
            raise RejectedInputError('IMU: a value is NaN or infinite: check the driver')
        if np.linalg.norm(self.specific_force) > _SPECIFIC_FORCE_MAX:
            raise RejectedInputError('IMU: the acceleration is above 300 m/s^2: check its unit')
        if np.linalg.norm(self.angular_velocity) > _ANGULAR_VELOCITY_MAX:
            raise RejectedInputError('IMU: the angular velocity is above 40 rad/s: check its unit')
        if self.attitude is not None:
            norm = float(np.linalg.norm(self.attitude))
            if not 0.9 < norm < 1.1:
                raise RejectedInputError(
                    f'IMU: the orientation quaternion has length {norm:.3g}, not 1: a zero '
                    'quaternion means no attitude; set orientation_covariance[0] to -1'
                )
            object.__setattr__(self, 'attitude', self.attitude / norm)
