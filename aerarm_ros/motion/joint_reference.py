"""What a motion asks of the joints at one instant, or at many, thesis (2.17)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.motion.float_array import FloatArray


# Here and in its neighbours a named tuple: one is made in every cycle of 1 ms, in 0.2 us.
class JointReference(NamedTuple):
    """Desired motion of n joints, at one instant (n,) or at many (M, n).

    Attributes
    ----------
    q, dq, ddq : (n,) or (M, n) ndarray
        q_d [rad], its velocity [rad/s] and acceleration [rad/s^2].
    """

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray

    @classmethod
    def at_rest(cls, q: ArrayLike) -> 'JointReference':
        """Return the reference that stays at `q` (n,) [rad]."""
        position = np.array(q, dtype=float)
        return cls(position, np.zeros_like(position), np.zeros_like(position))

    def paced(self, rate: FloatArray | float, rate_change: FloatArray | float) -> 'JointReference':
        """Return this point of a path where the path is passed at another rate.

        Parameters
        ----------
        rate, rate_change : float or (M, 1) ndarray
            Rate of the time along the path [-] and that rate's derivative [1/s].
        """
        return JointReference(self.q, rate * self.dq, rate**2 * self.ddq + rate_change * self.dq)
