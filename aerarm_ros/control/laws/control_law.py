"""What every control law offers to a control loop."""

from typing import Protocol, TypeVar

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.motion.arm_state import ArmState
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_command import JointCommand

Followed = TypeVar('Followed', contravariant=True)


class ControlLaw(Protocol[Followed]):
    """Turns state and reference into a command."""

    def take_over(self, q: FloatArray) -> None:
        """Start at the present posture (n,) [rad]."""

    def update(
        self, state: ArmState, reference: Followed, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the command for this cycle of `dt` [s]."""
        ...
