"""References, states and commands of joints and tool, in the thesis's symbols."""

from enum import Enum
from math import sqrt
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

Array = npt.NDArray[np.float64]


def limited(vector: Array, length: float) -> Array:
    """Return a vector (k,), shortened to `length` if it is longer."""
    norm = sqrt(vector @ vector)
    return vector if norm <= length else (length / norm) * vector


class Reaction(Enum):
    """Reaction of a controller to a contact during motion; each value is a parameter value."""

    REPORT = 'report'
    STOP = 'stop'
    RETREAT = 'retreat'
    COMPLY = 'comply'


REACTIONS = tuple(reaction.value for reaction in Reaction)
"""Names of the reactions."""


class ArmState(NamedTuple):
    """Measured state of n joints.

    Attributes
    ----------
    q, dq : (n,) ndarray
        Position [rad] and velocity [rad/s].
    tau : (n,) ndarray
        Drive torque at the joints [Nm], from the motor currents.
    """

    q: Array
    dq: Array
    tau: Array


class JointCommand(NamedTuple):
    """Command for n joints; the fields that are set select the control loop of the boards.

    Effort alone means torque control. Velocity alone means the boards' velocity loop, with effort
    as optional feed-forward. All three fields mean the boards' full law (4.4) with feed-forward.

    Attributes
    ----------
    q, dq, tau : (n,) ndarray or None
        Position [rad], velocity [rad/s] and effort [Nm].
    """

    q: Array | None = None
    dq: Array | None = None
    tau: Array | None = None


# The types below are named tuples, which are created in 0.2 us, because one is created in every 1
# ms cycle.
class JointReference(NamedTuple):
    """Desired motion of n joints, at one instant (n,) or at M instants (M, n).

    Attributes
    ----------
    q, dq, ddq : (n,) or (M, n) ndarray
        Desired position q_d [rad], velocity [rad/s] and acceleration [rad/s^2].
    """

    q: Array
    dq: Array
    ddq: Array

    @classmethod
    def at_rest(cls, q: ArrayLike) -> 'JointReference':
        """Return a reference at rest at `q` (n,) [rad]."""
        position = np.array(q, dtype=float)
        return cls(position, np.zeros_like(position), np.zeros_like(position))

    def paced(self, rate: Array | float, rate_change: Array | float) -> 'JointReference':
        """Return this reference for the case that its path is followed at another rate.

        Parameters
        ----------
        rate, rate_change : float or (M, 1) ndarray
            Rate of the path time [-] and its derivative [1/s].
        """
        return JointReference(self.q, rate * self.dq, rate**2 * self.ddq + rate_change * self.dq)


class JointMotion(Protocol):
    """Interface of a motion of all joints, from time 0 to its duration."""

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        ...

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference at `time` [s], a scalar or (M,)."""
        ...


class TaskReference(NamedTuple):
    """Desired motion of the tool frame's origin, in the base frame.

    Attributes
    ----------
    p, dp, ddp : (3,) ndarray
        Desired position p_d [m], velocity [m/s] and acceleration [m/s^2].
    """

    p: Array
    dp: Array
    ddp: Array
