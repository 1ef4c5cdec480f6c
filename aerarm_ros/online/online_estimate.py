"""What an arm carries, and its friction, at an instant."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.payload.payload import Payload
from aerarm_ros.model.inertia import PARAMETER_NAMES

Array = npt.NDArray[np.float64]

FRICTION_NAMES = ('viscous [Nms/rad]', 'Coulomb [Nm]', 'load')
"""Of the rows of `OnlineEstimate.friction`."""

_UNKNOWN = 0.5  # of the prior's standard deviation


@dataclass(frozen=True, eq=False)
class OnlineEstimate:
    """One estimate of a `PayloadEstimator`.

    Attributes
    ----------
    time : float
        Of the state that it follows [s].
    payload : Payload
        Beyond what the arm's model has; a speck of 1e-6 kg stands for nothing. Its covariance is
        that before it is known that the payload is a body.
    carries : bool
        Whether something is carried.
    since : float
        Time [s] of the last pick-up or put-down that was found; minus infinity before the first.
    prior_std : (10,) ndarray
        Of the payload's parameters, before there was a motion.
    friction, friction_std : (3, n) ndarray
        Viscous [Nms/rad], Coulomb [Nm] and load friction [-] of the joints, as they are by now.
    residual : (n,) ndarray
        RMS torque that remains unexplained [Nm].
    """

    time: float
    payload: Payload
    carries: bool
    since: float
    prior_std: Array
    friction: Array
    friction_std: Array
    residual: Array

    @property
    def unexcited(self) -> tuple[str, ...]:
        """Names of the parameters that the motion tells little of: they are near the prior."""
        known = self.payload.std < _UNKNOWN * self.prior_std
        return tuple(
            name for name, is_known in zip(PARAMETER_NAMES, known, strict=True) if not is_known
        )
