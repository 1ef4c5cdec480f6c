"""A part of what a motion costs."""

from typing import NamedTuple, Protocol

from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference


class TermValue(NamedTuple):
    """An integral over a motion, and its derivatives by what the motion does at each instant.

    Attributes
    ----------
    value : float
    by_q, by_dq, by_ddq : (M, n) ndarray
        The sum over the instants is the integral's change with positions, velocities and
        accelerations.
    """

    value: float
    by_q: FloatArray
    by_dq: FloatArray
    by_ddq: FloatArray


class CostTerm(Protocol):
    """An integral over time of something that the motion is at each instant."""

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the integral over M instants that stand for `dt` [s] each."""
        ...
