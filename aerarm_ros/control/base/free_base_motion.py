"""Motion of a base that is free: it answers its rotors and the arm."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion

Array = npt.NDArray[np.float64]


class FreeBaseMotion(BaseMotion):
    """A `BaseMotion` whose accelerations lack how the base answers.

    With the answer `M_bb^-1 (w - c_b - M_bj ddq)` of `WholeBodyDynamics`, the base accelerates by
    `s = s_0 + share * answer`: s_0 is `specific_force` and `angular_acceleration`.

    Parameters
    ----------
    motion : BaseMotion
    wrench : (6,) ndarray
        w, of the rotors on the base at its origin, in base axes [N], [Nm].
    share : (6,) ndarray
        How much of the answer is believed, for each component of the acceleration. With none
        the base is moved, whatever rotors and arm do.

    Attributes
    ----------
    wrench, share
        As given.
    """

    wrench: Array
    share: Array

    def __new__(cls, motion: BaseMotion, wrench: Array, share: Array) -> 'FreeBaseMotion':
        """Return a motion with its answer."""
        free = super().__new__(cls, *motion)
        free.wrench = wrench
        free.share = share
        return free
