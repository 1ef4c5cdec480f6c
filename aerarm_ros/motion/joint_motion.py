"""A motion of the joints, whatever it is made of."""

from typing import Protocol

from numpy.typing import ArrayLike

from aerarm_ros.motion.joint_reference import JointReference


class JointMotion(Protocol):
    """A motion of all joints over [0, duration]."""

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        ...

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], a scalar or (M,)."""
        ...
