"""What a Cartesian law has to follow at one instant."""

from typing import NamedTuple

from aerarm_ros.motion.float_array import FloatArray


class TaskReference(NamedTuple):
    """Desired motion of a frame's origin, in the base frame.

    Attributes
    ----------
    p, dp, ddp : (3,) ndarray
        p_d [m], its velocity [m/s] and acceleration [m/s^2].
    """

    p: FloatArray
    dp: FloatArray
    ddp: FloatArray
