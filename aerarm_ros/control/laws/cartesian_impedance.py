"""Cartesian impedance control: the tool behaves like a spring and damper."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import finite, non_negative, non_negative_number, positive
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.signals import ArmState, Array, JointCommand, TaskReference


class CartesianImpedance:
    """Control law that gives the tool stiffness and damping (Hogan 1985; Khatib 1987).

    With the task inertia `L = (J B^-1 J^T + s^2 1)^-1`, where the small regularization s keeps L
    finite if J loses rank::

        F   = L ddpd + K (pd - p) + D (dpd - dp)
        tau = n(q, dq) + J^T F + N^T (Kn (q_rest - q) - Dn dq)

    so that a force f moves the tool as `L dde + D de + K e = -f`, apart from dJ dq. The inertia
    stays that of the arm, so no force needs to be measured. `N^T` projects the posture's torque so
    that it does not move the tool.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the controlled frame.
    stiffness, damping : (3,) array_like
        K [N/m] and D [Ns/m] along the base's axes.
    rest : (n,) array_like
        Home configuration [rad].
    rest_stiffness, rest_damping : float
        Kn [Nm/rad], Dn [Nms/rad]
    friction : FrictionCompensation, optional
        Compensation by measured velocity; its fraction must be below one.
    regularisation : float
        s [1/sqrt(kg)]; it limits the task inertia to 1/s^2.

    Attributes
    ----------
    stiffness, damping : (3,) ndarray
        May be replaced at any time.

    Raises
    ------
    ValueError
        If a gain is negative, or the number of gains or of joints is wrong.
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        kinematics: Kinematics,
        stiffness: npt.ArrayLike,
        damping: npt.ArrayLike,
        rest: npt.ArrayLike,
        rest_stiffness: float = 2.0,
        rest_damping: float = 0.3,
        friction: FrictionCompensation | None = None,
        regularisation: float = 0.1,
    ) -> None:
        self._dynamics = dynamics
        self._kinematics = kinematics
        self.stiffness = non_negative('stiffness', stiffness, 3)
        self.damping = non_negative('damping', damping, 3)
        self._rest = finite('rest', rest, dynamics.n)
        self._rest_stiffness = non_negative_number('rest_stiffness', rest_stiffness)
        self._rest_damping = non_negative_number('rest_damping', rest_damping)
        self._friction = friction
        self._floor = positive('regularisation', regularisation) ** 2 * np.eye(3)

    def take_over(self, q: Array) -> None:
        """Do nothing, because the law has no memory of earlier cycles."""

    def update(
        self, state: ArmState, reference: TaskReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the joint efforts (n,) [Nm] of the impedance law; `dt` is not used."""
        q, dq, _ = state
        jacobian = self._kinematics.position_jacobian(q)
        mobility = self._dynamics.mobility_matrix(q, base) @ jacobian.T
        force = self.stiffness * (reference.p - self._kinematics.position(q))
        force += self.damping * (reference.dp - jacobian @ dq)
        posture = self._rest_stiffness * (self._rest - q) - self._rest_damping * dq
        # L times the desired acceleration without the effect of the posture's torque on the task:
        # N^T = 1 - J^T (L J B^-1), dynamically consistent.
        wanted = reference.ddp - mobility.T @ posture
        force += _solved(jacobian @ mobility + self._floor, wanted)
        bias = self._dynamics.bias(q, dq, base)
        tool: Array = jacobian.T @ force
        u = bias + tool + posture
        if self._friction is not None:
            u += self._friction.torque(dq, bias)
        return JointCommand(tau=u)


def _solved(matrix: Array, vector: Array) -> Array:
    """Solve A x = b for a symmetric positive definite matrix A (3, 3), by Cramer's rule.

    For three equations LAPACK takes three times as long, and may start threads.
    """
    (a, b, c), (_, d, e), (_, _, f) = matrix.tolist()
    u, v, w = vector.tolist()
    first, second, third = d * f - e * e, c * e - b * f, b * e - c * d
    fourth, fifth, sixth = a * f - c * c, b * c - a * e, a * d - b * b
    x = (
        first * u + second * v + third * w,
        second * u + fourth * v + fifth * w,
        third * u + fifth * v + sixth * w,
    )
    solution: Array = np.array(x) / (a * first + b * second + c * third)
    return solution
