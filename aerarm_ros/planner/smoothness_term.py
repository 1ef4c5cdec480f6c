"""A price of acceleration, for what costs nothing else."""

import numpy as np

from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.planner.cost_term import TermValue


class SmoothnessTerm:
    """Integral of the accelerations squared.

    How a light joint goes its way makes hardly a difference to energy, so a search leaves it
    anywhere: creeping so slowly that dry friction holds the joint beside its reference. With a
    price of acceleration such a joint moves evenly.

    Parameters
    ----------
    price : (n,) ndarray
        Of each joint [J s^3/rad^2], see `prices_by_lightness`.
    """

    def __init__(self, price: FloatArray) -> None:
        self._price = price

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        slope = 2.0 * self._price * dt * motion.ddq
        nothing = np.zeros_like(motion.q)
        return TermValue(0.5 * float((slope * motion.ddq).sum()), nothing, nothing, slope)


def prices_by_lightness(price: float, inertia: FloatArray) -> FloatArray:
    """Return what acceleration costs each joint, (n,) [J s^3/rad^2].

    Of a wrong torque a light joint takes more acceleration and, feedback of computed torque being
    an acceleration too, more error: both over its inertia. So does the price go; where there is
    little to move, evenness costs little energy.

    Parameters
    ----------
    price : float
        Of the joint that moves most inertia [J s^3/rad^2].
    inertia : (n,) ndarray
        That the joints move, each alone [kg m^2].
    """
    lightness: FloatArray = inertia.max() / inertia
    return price * lightness
