"""What a motion does to the drone that carries the arm."""

import numpy as np

from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.planner.cost_term import TermValue


class DisturbanceTerm:
    """Moment of a motion's reaction on the base, its peak above all.

    The reaction is what links and rotors take to be moved, `M_bj ddq + c_b` of the free-base
    model: weight is left out, since where the arm is, is not the motion's to choose. The integral
    of ``scale^2 (|m| / scale)^(2 power)``.

    Parameters
    ----------
    body : WholeBodyDynamics
    price : float
        [J/(Nm)^2/s], at a moment of `scale`.
    scale : float
        Moment beyond which the price rises steeply [Nm].
    power : int
        The higher, the more the peak counts and the less the rest.
    """

    def __init__(self, body: WholeBodyDynamics, price: float, scale: float, power: int = 3) -> None:
        self._body = body
        self._price = price
        self._scale = scale
        self._power = power

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        count, n = motion.q.shape
        moment, slopes = np.empty((count, 3)), np.empty((3, count, 3, n))
        for k, row in enumerate(zip(*motion, strict=True)):
            wrench, *by = self._body.reaction_with_slopes(*row)
            moment[k] = wrench[3:]
            slopes[:, k] = [slope[3:] for slope in by]
        square = (moment**2).sum(axis=1) / self._scale**2
        value = dt * self._price * self._scale**2 * float((square**self._power).sum())
        factor = 2.0 * dt * self._price * self._power * square ** (self._power - 1)
        by_moment = factor[:, np.newaxis] * moment
        return TermValue(value, *np.einsum('mi,dmij->dmj', by_moment, slopes))


def peak_moment(body: WholeBodyDynamics, motion: JointReference) -> float:
    """Return the largest moment of a motion's reaction on the base [Nm], of M instants."""
    still = np.zeros(3)
    rows: list[FloatArray] = [body.forces(*row, still)[3:6] for row in zip(*motion, strict=True)]
    return float(np.linalg.norm(rows, axis=1).max())
