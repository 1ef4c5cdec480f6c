"""A deviation that fades to nothing, so that one reference can replace another."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.checks.joint_limits import JointLimits
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.motion.polynomial_path import PolynomialPath

Array = npt.NDArray[np.float64]

_SHORTEST = 0.05
# Of a joint's limits, what a blend may use beside the motion it is added to.
_SHARE = 0.3


class Blend:
    """Deviation between an old and a new reference, brought to zero by a quintic.

    Added to the new motion, it starts where the old one was, with its velocity and
    acceleration, so that replacing a reference never steps.

    Parameters
    ----------
    deviation : JointReference
        Old minus new reference at time zero.
    limits : JointLimits

    Attributes
    ----------
    duration : float
        [s]
    """

    def __init__(self, deviation: JointReference, limits: JointLimits) -> None:
        needed = (
            np.abs(deviation.q) / (_SHARE * limits.velocity_max),
            np.sqrt(np.abs(deviation.q) / (_SHARE * limits.acceleration_max)),
            np.abs(deviation.dq) / (_SHARE * limits.acceleration_max),
        )
        # 2: the peak slope of a quintic step is 1.9, the peak curvature after the square root
        # 2.4, and a braking quintic peaks at 1.5 to 2 times its mean.
        self.duration = max(_SHORTEST, 2.0 * float(np.max(needed)))
        ends = [np.array([start, np.zeros_like(start)]) for start in deviation]
        self._path = PolynomialPath.quintic((0.0, self.duration), *ends)

    def add_to(self, reference: JointReference, time: float) -> JointReference:
        """Return `reference` plus what is left of the deviation after `time` [s].

        Nothing is left after `duration`.
        """
        rest = self._path.evaluate(time)
        return JointReference(
            reference.q + rest.q, reference.dq + rest.dq, reference.ddq + rest.ddq
        )
