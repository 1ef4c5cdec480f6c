"""One reading of where the drone is."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.rejected_input_error import RejectedInputError

Array = npt.NDArray[np.float64]

# Beyond these an odometry is wrong rather than a flight bold.
_POSITION_MAX, _SPEED_MAX, _RATE_MAX = 1e5, 100.0, 40.0


@dataclass(frozen=True, eq=False)
class OdometrySample:
    """A checked sample with the conventions of nav_msgs/Odometry.

    Attributes
    ----------
    stamp : float
        [s]
    position : (3,) ndarray
        Of the body frame's origin in the world [m].
    attitude : (4,) ndarray
        Quaternion (x, y, z, w), body to world. Normalised when made.
    velocity, rate : (3,) ndarray
        In body axes [m/s], [rad/s].

    Raises
    ------
    RejectedInputError
        If a number isn't finite, the quaternion is none, or a value can't be in the unit
        expected.
    """

    stamp: float
    position: Array
    attitude: Array
    velocity: Array
    rate: Array

    def __post_init__(self) -> None:
        """Check every number."""
        numbers = [self.stamp, *self.position, *self.attitude, *self.velocity, *self.rate]
        if not np.all(np.isfinite(numbers)):
            raise RejectedInputError('odometry: a value is NaN or infinite: check its source')
        norm = float(np.linalg.norm(self.attitude))
        if not 0.9 < norm < 1.1:
            raise RejectedInputError(
                f'odometry: the orientation quaternion has length {norm:.3g}, not 1'
            )
        for name, vector, limit, unit in (
            ('position', self.position, _POSITION_MAX, 'm'),
            ('velocity', self.velocity, _SPEED_MAX, 'm/s'),
            ('angular velocity', self.rate, _RATE_MAX, 'rad/s'),
        ):
            if np.linalg.norm(vector) > limit:
                raise RejectedInputError(
                    f'odometry: the {name} is above {limit:g} {unit}: check its unit'
                )
        object.__setattr__(self, 'attitude', self.attitude / norm)
