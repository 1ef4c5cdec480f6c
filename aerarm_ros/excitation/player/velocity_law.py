"""Excitation by velocity commands."""

from __future__ import annotations

import numpy as np

from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.joint_reference import JointReference


class VelocityLaw:
    """Kinematic control: dq_cmd = dq_d + K (q_d - q), thesis section 2.5.2 in joint space.

    The boards integrate the velocity reference, so the posture drifts only by what their
    velocity loop leaves; a small K takes that away without stiffening the loop.

    Parameters
    ----------
    gain : K [1/s], 0 for the thesis's pure velocity commands.
    limit : (n,) largest speed commanded [rad/s]. The reference is checked before it is played,
        the correction cannot be: it depends on how well the arm follows.
    """

    def __init__(self, gain: float, limit: FloatArray | float = np.inf) -> None:
        self._gain = gain
        self._limit: FloatArray = np.asarray(limit, dtype=float)

    def command(self, reference: JointReference, position: FloatArray) -> JointCommand:
        """Return the velocity command for the measured `position` (n,) [rad]."""
        correction = self._gain * (reference.q - position)
        # In the 1 kHz loop, where np.clip would take longer than all the rest.
        velocity = np.minimum(reference.dq + correction, self._limit)
        return JointCommand(dq=np.maximum(velocity, -self._limit))
