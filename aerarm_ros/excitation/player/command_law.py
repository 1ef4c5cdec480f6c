"""From a reference and the measured posture to a joint command."""

from __future__ import annotations

from typing import Protocol

from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_command import JointCommand
from aerarm_ros.motion.joint_reference import JointReference


class CommandLaw(Protocol):
    """What a command mode does with the reference."""

    def command(self, reference: JointReference, position: FloatArray) -> JointCommand:
        """Return the command for the measured `position` (n,) [rad]."""
        ...
