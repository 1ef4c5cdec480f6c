"""What the drives take, and how far they are beyond their limits."""

import numpy as np

from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.motion.float_array import FloatArray
from aerarm_ros.motion.joint_reference import JointReference
from aerarm_ros.planner.cost_term import TermValue
from aerarm_ros.planner.limit_term import excess

# Over these a sign becomes smooth: of velocity [rad/s], of power [W].
_FRICTION_WIDTH = 0.03
_POWER_WIDTH = 0.05


class DriveTerm:
    """Energy that the supply gives [J], and a penalty of too much torque.

    Analytic by the derivatives of inverse dynamics. Dry friction and the end of recovery, where a
    motor begins to brake, are rounded off over small velocities and powers.

    Parameters
    ----------
    model : EnergyModel
    effort_max : (n,) ndarray
        Usable torque [Nm].
    price : float
        Of a joule [-]; 0 leaves the penalty alone.
    penalty : float
        Of (excess / limit)^2 [1/s].
    """

    def __init__(
        self, model: EnergyModel, effort_max: FloatArray, price: float, penalty: float
    ) -> None:
        self._dynamics = model.dynamics
        self._drives = model.drives
        self._friction = model.friction_of_width(_FRICTION_WIDTH)
        self._effort_max = effort_max
        self._price = price
        self._penalty = penalty

    def __call__(self, motion: JointReference, dt: float) -> TermValue:
        """Return the term, see `CostTerm`."""
        q, dq, ddq = motion
        shape = q.shape
        rigid, slopes = np.empty(shape), np.empty((3, *shape, shape[1]))
        for k in range(len(q)):
            rigid[k], slopes[0, k], slopes[1, k], slopes[2, k] = self._dynamics.inverse_with_slopes(
                q[k], dq[k], ddq[k]
            )
        rotors = self._dynamics.rotor_inertia
        load = rigid - rotors * ddq  # what turns the rotors does not go through the gears
        tau = rigid + self._friction.torque(dq, load)
        value, by_tau, by_dq = self._density(tau, dq)
        friction_by_dq, friction_by_load = self._friction.slopes(dq, load)
        by_load = dt * by_tau * friction_by_load
        by_rigid = dt * by_tau + by_load
        by_q, by_dq_of_rigid, by_ddq = np.einsum('mi,dmij->dmj', by_rigid, slopes)
        by_dq = dt * (by_dq + by_tau * friction_by_dq) + by_dq_of_rigid
        return TermValue(dt * value, by_q, by_dq, by_ddq - by_load * rotors)

    def _density(self, tau: FloatArray, dq: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Return the sum over the instants of cost a second, and its slopes by torque, velocity."""
        drives = self._drives
        power = drives.electrical(tau, dq)
        # From the supply comes power + (1 - recovery) max(-power, 0).
        root = np.sqrt(power**2 + _POWER_WIDTH**2)
        lost = 1.0 - drives.recovery
        taken = power + lost * 0.5 * (root - power)
        by_power = self._price * (1.0 + lost * 0.5 * (power / root - 1.0))
        too_much = excess(tau, self._effort_max, self._penalty)
        by_tau = by_power * (2.0 * drives.copper_per_torque2 * tau + drives.shaft * dq)
        by_dq: FloatArray = by_power * drives.shaft * tau
        return self._price * float(taken.sum()) + too_much.value, by_tau + too_much.slope, by_dq
