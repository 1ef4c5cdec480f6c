"""Control law that holds the tool in the world, on a base that the arm's motion moves."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits, finite, non_negative_number, positive
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.control.laws.kinematic_control import DampedInverse, resolve_within
from aerarm_ros.model.inertia import cross
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.motion.path_stop import brake
from aerarm_ros.motion.polynomial_path import PolynomialPath
from aerarm_ros.motion.signals import ArmState, Array, JointCommand, JointReference, limited
from aerarm_ros.world.base_pose import BasePose, rotation_vector
from aerarm_ros.world.rotor_governor import ReactionLimit

# Fraction of the acceleration limits for braking in the base frame.
_BRAKE_SHARE = 0.7
# Rates [1/s] at which a joint's velocity returns to its limits, and at which a joint approaches a
# position limit over its distance.
_VELOCITY_RATE, _LIMIT_RATE = 40.0, 8.0
_LIMIT_MARGIN = 0.03  # [rad] margin to position limits
_ANGLE_MAX = 0.3  # [rad] largest orientation error in the feedback
_NO_FORCE = np.zeros(3)


class WorldReference(NamedTuple):
    """Reference of the tool's motion in the world frame.

    Attributes
    ----------
    p, dp, ddp : (3,) ndarray
        Position of the tool in the world [m], its velocity [m/s] and acceleration [m/s^2].
    rotation : (3, 3) ndarray or None
        Desired orientation, tool to world; None for any orientation.
    base : BasePose or None
        Pose of the base. None if the tool cannot be held in the world; then the arm stops in the
        base frame.
    contact : (3,) ndarray
        Known force of a contact on the tool, in the world [N].
    """

    p: Array
    dp: Array
    ddp: Array
    rotation: Array | None
    base: BasePose | None
    contact: Array = _NO_FORCE


class WorldGains(NamedTuple):
    """Gains of the control law for the tool in the world, `WorldLaw`.

    Attributes
    ----------
    kp, kd : float
        Gains of the tool's position [1/s^2], [1/s].
    orientation_weight : float
        Weight of the orientation relative to the posture, in the null space of the tool's position
        [-].
    posture_kp, posture_kd : float
        Gains of the posture in that null space [1/s^2], [1/s].
    joint_kp, joint_kd : float
        Gains of the joints while the arm stays in the base frame [1/s^2], [1/s].
    """

    kp: float = 400.0
    kd: float = 40.0
    orientation_weight: float = 1.0
    posture_kp: float = 4.0
    posture_kd: float = 4.0
    joint_kp: float = 400.0
    joint_kd: float = 40.0


class WorldLaw:
    """Computed torque control of the tool in the world, with the generalized Jacobian.

    The generalized Jacobian is that of Umetani and Yoshida (1989), for a base that rotors drive and
    that responds to the arm.

    All quantities are in base axes, about the origin of the base. `J_b` and `J_q` are the tool's
    Jacobians of base and joints, s is the base's specific force and angular acceleration, and `(w
    - c_b)` the rotors' wrench without centrifugal forces::

        J_g  = J_q - J_b M_bb^-1 M_bj
        ddx  = J_b (s_0 + M_bb^-1 (w - c_b)) + g + J_g ddq + b(q, dq, omega)
        ddq  = J_g^# (ddx_d + Kd (dx_d - dx) + Kp (x_d - x) - a_0)
               + (1 - J_g^# J_g) z
        tau  = M_jb s + M_jj ddq + c_j - J_q^T f

    f is the known force of a contact on the tool. The rotors' wrench w of the base's motion must
    already contain the wrench of f on drone and arm (`FreeBaseEstimator.contact`). a_0 is the
    tool's acceleration at ddq = 0, and `b` contains the velocity terms. `s_0` and the weight of the
    base's response come from `FreeBaseMotion`. On a base with known motion, J_g is
    the ordinary Jacobian and s is measured. `J_g^#` is the `DampedInverse`. The null-space
    acceleration z leads to the posture and, by weighted least squares, to the desired orientation.
    Joints respect their limits of position, velocity and acceleration; other joints replace the
    motion of a limited one.

    Without a base pose the arm brakes and stays in the base frame.

    Parameters
    ----------
    kinematics : Kinematics
        Kinematics of the tool frame that is held.
    posture : (n,) array_like or None
        Posture in the null space of the tool [rad]; by default that at the start of control.
    inverse : DampedInverse
        Damped inverse of a Jacobian in m/rad.

    Attributes
    ----------
    posture : (n,) ndarray
        Posture in the null space of the tool [rad]; may be replaced.
    acceleration_max : (n,) ndarray
        Limits of the joints [rad/s^2].
    limit : ReactionLimit or None
        Limit of the joints' acceleration. Braking at a joint's limit is exempt.
    error : (3,) ndarray
        Error of the tool, along the base's axes [m].
    least_singular_value : float
        Least singular value of J_g [m/rad], the distance to a singularity.
    ddq : (n,) ndarray
        Last commanded joint acceleration [rad/s^2].
    is_stopped : bool
        Whether the arm stays in the base frame.
    jacobian, task : (3, n) ndarray
        Last Jacobian J_q of the tool and its generalized Jacobian J_g, in base axes [m/rad].
    contact : (3,) ndarray
        Last known force of a contact on the tool, in base axes [N].
    velocity : (3,) ndarray
        Last velocity of the tool relative to the world, in base axes [m/s].
    """

    def __init__(
        self,
        dynamics: MovingBaseDynamics,
        kinematics: Kinematics,
        limits: JointLimits,
        posture: npt.ArrayLike | None = None,
        gains: WorldGains | None = None,
        inverse: DampedInverse | None = None,
        friction: FrictionCompensation | None = None,
    ) -> None:
        self._dynamics = dynamics
        self._kinematics = kinematics
        self._limits = limits
        self.gains = gains = WorldGains() if gains is None else gains
        for name, value in zip(gains._fields, gains, strict=True):
            non_negative_number(name, value)
        positive('kp', gains.kp)
        self._inverse = DampedInverse(0.06, 0.03) if inverse is None else inverse
        self._friction = friction
        self._keeps = posture is not None
        self.posture = finite('posture', 0.0 if posture is None else posture, limits.n)
        self.acceleration_max = limits.acceleration_max.copy()
        self.limit: ReactionLimit | None = None
        self._low = limits.position_min + _LIMIT_MARGIN
        self._high = limits.position_max - _LIMIT_MARGIN
        self.least_singular_value = np.inf
        self.take_over(np.zeros(limits.n))

    def take_over(self, q: Array) -> None:
        """Start at the present posture, with the integral at zero."""
        if not self._keeps:
            self.posture = np.array(q)
        self._forget()
        self._brake: tuple[PolynomialPath, float] | None = None
        self._time = 0.0
        self.error = np.zeros(3)
        self.ddq = np.zeros(self._limits.n)
        self.is_stopped = False
        self.jacobian = self.task = np.zeros((3, self._limits.n))
        self.contact = _NO_FORCE
        self.velocity = np.zeros(3)

    def _forget(self) -> None:
        if self.limit is not None:
            self.limit.reset()

    def update(
        self, state: ArmState, reference: WorldReference, dt: float, base: BaseMotion | None = None
    ) -> JointCommand:
        """Return the effort (n,) [Nm] for this cycle of `dt` [s]."""
        self._time += dt
        motion = self._dynamics.still if base is None else base
        if reference.base is None:
            return self._stay(state, motion)
        self._brake, self.is_stopped = None, False
        self.contact = reference.base.rotation.T @ reference.contact
        self.ddq = self._wanted(state, reference, reference.base, motion, dt)
        return self._command(state, self.ddq, motion, state.dq)

    def _stay(self, state: ArmState, base: BaseMotion) -> JointCommand:
        """Return the effort (n,) [Nm] that brakes the arm and holds it in the base frame."""
        if self._brake is None:
            start = JointReference(state.q, state.dq, np.zeros(self._limits.n))
            path = brake(start, _BRAKE_SHARE * self._limits.acceleration_max)
            self._brake = path, self._time
            self._forget()
            self.is_stopped, self.contact = True, _NO_FORCE
        path, begin = self._brake
        q, dq, ddq = path.evaluate(self._time - begin)
        gains = self.gains
        self.ddq = ddq + gains.joint_kd * (dq - state.dq) + gains.joint_kp * (q - state.q)
        # At rest, dry friction holds the joints; compensation would let them slip.
        return self._command(state, self.ddq, base, dq)

    def _command(
        self, state: ArmState, ddq: Array, base: BaseMotion, sliding: Array
    ) -> JointCommand:
        """Return the effort for an acceleration, with the friction of the velocity `sliding`."""
        u = self._dynamics.inverse(state.q, state.dq, ddq, base)
        if self._friction is not None:
            load = u - self._dynamics.fixed.rotor_inertia * ddq
            u = u + self._friction.torque(sliding, load)
        if self.contact.any():
            u = u - self.jacobian.T @ self.contact
        return JointCommand(tau=u)

    def _wanted(
        self,
        state: ArmState,
        reference: WorldReference,
        pose: BasePose,
        base: BaseMotion,
        dt: float,
    ) -> Array:
        """Return the joint acceleration (n,) [rad/s^2] that moves the tool along the reference."""
        q, dq, _ = state
        transform = self._kinematics.transform(q)
        place = transform[:3, 3]
        jacobian = self._kinematics.jacobian(q)
        linear, angular = jacobian[:3], jacobian[3:]
        rate, to_base = pose.rate, pose.rotation.T
        slide = linear @ dq
        self.velocity = velocity = to_base @ pose.velocity + cross(rate, place) + slide
        gains = self.gains
        self.error = error = to_base @ (reference.p - pose.position) - place
        wanted = to_base @ reference.ddp + gains.kp * error
        wanted = wanted + gains.kd * (to_base @ reference.dp - velocity)
        pushed, answer = self._drift(q, dq, base)
        spin = pushed[3:]
        # Acceleration of the tool without joint acceleration.
        curve = cross(rate, cross(rate, place) + 2.0 * slide)
        own = self._kinematics.acceleration_bias(q, dq)
        drift = pushed[:3] + cross(spin, place) + base.gravity + curve + own[:3]
        task = linear - (answer[:3] + np.array([cross(c, place) for c in answer[3:].T]).T)
        self.jacobian, self.task = linear, task
        preferred = gains.posture_kp * (self.posture - q) - gains.posture_kd * dq
        if reference.rotation is not None and gains.orientation_weight:
            off = rotation_vector(to_base @ reference.rotation @ transform[:3, :3].T)
            turned = angular @ dq
            turn = gains.kp * limited(off, _ANGLE_MAX) - gains.kd * (turned + rate)
            turn = turn - spin - own[3:] - cross(rate, turned)
            preferred = self._with_orientation(
                task, wanted - drift, preferred, angular - answer[3:], turn
            )
        low, high = self._bounds(q, dq)
        ddq, self.least_singular_value = resolve_within(
            self._inverse, task, wanted - drift, preferred, low, high
        )
        if self.limit is not None:
            ddq = self.limit(q, dq, ddq, dt)
        return np.minimum(np.maximum(ddq, low), high)

    def _drift(self, q: Array, dq: Array, base: BaseMotion) -> tuple[Array, Array]:
        """Return the base's acceleration (6,) at ddq = 0, and its decrease per ddq (6, n)."""
        own = np.concatenate([base.specific_force, base.angular_acceleration])
        if not isinstance(base, FreeBaseMotion):
            return own, np.zeros((6, self._limits.n))
        whole = self._dynamics.whole
        forces = whole.forces(q, dq, np.zeros(self._limits.n), base.angular_velocity)[:6]
        inverse, coupling = whole.response(q)
        share = base.share
        answer = share[:, np.newaxis] * (inverse @ coupling)
        return own + share * (inverse @ (base.wrench - forces)), answer

    def _with_orientation(
        self, task: Array, place: Array, preferred: Array, turning: Array, turn: Array
    ) -> Array:
        """Return the null-space acceleration z for the orientation and the preferred z.

        z minimizes `weight |turning ddq - turn|^2 + |z - preferred|^2` with
        `ddq = J^# place + N z`.
        """
        found, weight = self._inverse.of(task), self.gains.orientation_weight
        free = turning @ found.null_space
        left = turn - turning @ (found.inverse @ place)
        matrix = weight * free.T @ free + np.eye(len(preferred))
        return np.asarray(np.linalg.solve(matrix, weight * free.T @ left + preferred))

    def _bounds(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the accelerations (n,) [rad/s^2] between which no joint leaves its limits."""
        fastest = self._limits.velocity_max
        upper = np.minimum(fastest, _LIMIT_RATE * (self._high - q))
        lower = np.maximum(-fastest, _LIMIT_RATE * (self._low - q))
        most = self.acceleration_max
        high = np.minimum(most, _VELOCITY_RATE * (upper - dq))
        low = np.maximum(-most, _VELOCITY_RATE * (lower - dq))
        # A joint that must brake does so beyond its acceleration limit.
        return np.minimum(low, high), np.maximum(low, high)
