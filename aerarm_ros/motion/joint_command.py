"""What a control law, or an excitation, asks of the bridge."""

from typing import NamedTuple

from aerarm_ros.motion.float_array import FloatArray


class JointCommand(NamedTuple):
    """Command for n joints; which fields are given chooses the boards' loop.

    Effort alone is torque control, velocity alone the boards' velocity loop, both that loop with
    the effort as feed-forward, and all three the boards' full law (4.4) with it.

    Attributes
    ----------
    q, dq, tau : (n,) ndarray or None
        Position [rad], velocity [rad/s] and effort [Nm].
    """

    q: FloatArray | None = None
    dq: FloatArray | None = None
    tau: FloatArray | None = None
