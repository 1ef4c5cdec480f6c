"""An arm without payload, as it is known before anything is learnt."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.parameters.joint_term import COUPLED, JointTerm, TermKind
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.online.estimator_settings import EstimatorSettings
from aerarm_ros.online.payload_estimator import PayloadEstimator

Array = npt.NDArray[np.float64]

_FOLLOWED = (TermKind.VISCOUS, TermKind.COULOMB, TermKind.LOAD)
_ELSEWHERE = (*_FOLLOWED, TermKind.ROTOR, *COUPLED)


@dataclass(frozen=True, eq=False)
class KnownArm:
    """What a `PayloadEstimator` is made from.

    Attributes
    ----------
    robot : Robot
    rotor_inertia : (n,) ndarray
        At the joints [kg m^2].
    friction : (3, n) ndarray
        Viscous [Nms/rad], Coulomb [Nm] and load friction [-].
    others : tuple of (int, JointTerm, float)
        Joint, term and coefficient of what else is known of the joints' torque.
    """

    robot: Robot
    rotor_inertia: Array
    friction: Array
    others: tuple[tuple[int, JointTerm, float], ...] = ()

    @classmethod
    def identified(cls, robot: Robot, estimate: Estimate) -> 'KnownArm':
        """Return the arm that an estimate describes."""
        model = estimate.model
        values = zip(model.joint_columns, estimate.theta[10 * model.n :], strict=True)
        return cls(
            robot.with_inertial_parameters(estimate.inertial),
            estimate.joint_values(TermKind.ROTOR.value),
            np.array([estimate.joint_values(kind.value) for kind in _FOLLOWED]),
            tuple(
                (joint, term, float(value))
                for (joint, term), value in values
                if term.kind not in _ELSEWHERE
            ),
        )

    def estimator(self, settings: EstimatorSettings | None = None) -> PayloadEstimator:
        """Return an estimator that starts with this arm."""
        dynamics = MovingBaseDynamics(self.robot, self.rotor_inertia)
        viscous, coulomb, load = self.friction
        return PayloadEstimator(dynamics, viscous, coulomb, load, settings)

    def other_torque(self, dq: Array) -> Array:
        """Return the torque (M, n) of the other terms at velocities (M, n) [Nm]."""
        torque = np.zeros_like(dq)
        for joint, term, value in self.others:
            velocity = dq[:, joint]
            torque[:, joint] += value * term.basis(velocity, velocity, None)
        return torque
