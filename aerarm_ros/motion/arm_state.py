"""What a controller knows about the arm at one instant."""

from typing import NamedTuple

from aerarm_ros.motion.float_array import FloatArray


class ArmState(NamedTuple):
    """Measured state of n joints.

    Attributes
    ----------
    q, dq : (n,) ndarray
        Position [rad] and velocity [rad/s].
    tau : (n,) ndarray
        Torque of the drives at the joints [Nm], from the motor currents.
    """

    q: FloatArray
    dq: FloatArray
    tau: FloatArray
