"""A reference that came as a single point."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.motion.joint_reference import JointReference

Array = npt.NDArray[np.float64]


class StreamedPoint:
    """The motion a single point stands for until the next one: constant acceleration.

    Parameters
    ----------
    point : JointReference
    duration : float
        How long it may be followed [s]; infinite for a posture to hold.
    """

    def __init__(self, point: JointReference, duration: float) -> None:
        self.duration = duration
        self._point = point
        self._is_at_rest = not (np.any(point.dq) or np.any(point.ddq))

    def evaluate(self, time: float) -> JointReference:
        """Return the reference `time` [s] after the point."""
        if self._is_at_rest:
            return self._point
        t = min(time, self.duration)
        q, dq, ddq = self._point
        return JointReference(q + t * (dq + (0.5 * t) * ddq), dq + t * ddq, ddq)
