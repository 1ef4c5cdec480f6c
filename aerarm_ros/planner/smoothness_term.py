"""A price of acceleration, for what costs nothing else."""

import numpy as np

from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.planner.cost_term import TermValue


class SmoothnessTerm:
    """Integral of the accelerations squared.

    How a light joint goes its way makes hardly a difference to energy, so a search leaves it
    anywhere: creeping so slowly that dry friction holds the joint beside its reference. With a
    small price of acceleration such a joint moves evenly.

    Parameters
    ----------
    price : float
        [J s^3/rad^2]
    """

    def __init__(self, price: float) -> None:
        self._price = price

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        slope = 2.0 * self._price * dt * motion.ddq
        nothing = np.zeros_like(motion.q)
        return TermValue(0.5 * float((slope * motion.ddq).sum()), nothing, nothing, slope)
