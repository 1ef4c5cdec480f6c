"""Inverse dynamics of an arm on a base that moves, or that responds to the arm's forces."""

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import Array


class MovingBaseDynamics:
    """Dynamics of an arm on a moving base, thesis (2.5): `B(q) ddq + h(q, dq, base) = xi`.

    For a base with known motion, the arm is attached to a free joint without gravity, whose
    acceleration is the base's specific force. One recursion yields the joint torques and the
    wrench at the mount. On a still base the model is that of a fixed base.

    For a base that responds (`FreeBaseMotion`), the rotors' wrench and the joints' acceleration
    add to the acceleration of `BaseMotion`::

        s = s_0 + share M_bb^-1 (w - c_b - M_bj ddq)
        xi = M_jb s + M_jj ddq + c_j

    so that B becomes `M_jj - share M_jb M_bb^-1 M_bj`; see `WholeBodyDynamics`.

    For use in a 1 kHz loop, arguments are not checked. An instance contains working memory: use
    one per thread.

    Parameters
    ----------
    robot, rotor_inertia, carrier
        As for `WholeBodyDynamics`; the vehicle `carrier` is needed for a base that responds.

    Attributes
    ----------
    fixed : Dynamics
        The arm on a fixed base; B and C do not depend on the base's motion.
    whole : WholeBodyDynamics
        Arm and vehicle.
    still : BaseMotion
        A base at rest under the robot's own gravity, used by default.

    Raises
    ------
    ValueError
        As `WholeBodyDynamics`.
    """

    def __init__(
        self, robot: Robot, rotor_inertia: npt.ArrayLike = 0.0, carrier: npt.ArrayLike | None = None
    ) -> None:
        self.robot = robot
        self.n = robot.n
        self.fixed = Dynamics(robot, rotor_inertia)
        self.still = BaseMotion.still(robot.gravity_in_base)
        self._arm = WholeBodyDynamics(robot, rotor_inertia)
        self.whole = self._arm
        if carrier is not None:
            self.whole = WholeBodyDynamics(robot, rotor_inertia, carrier)
        self._acceleration = np.zeros(6)
        self._zero = np.zeros(robot.n)

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a payload to the last link, see `Dynamics.carry`; an exception changes nothing."""
        self._arm.carry(payload)
        if self.whole is not self._arm:
            self.whole.carry(payload)
        self.fixed.carry(payload)

    def inverse(
        self,
        q: Array,
        dq: Array,
        ddq: Array,
        base: BaseMotion | None = None,
        planned: Array | None = None,
    ) -> Array:
        """Return the joint torques xi (n,) [Nm] of a motion, without friction.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            Positions [rad], velocities [rad/s] and accelerations [rad/s^2] of the joints.
        base : BaseMotion, optional
            Default: `still`.
        planned : (n,) ndarray, optional
            Joint acceleration to which the base responds [rad/s^2], by default `ddq`. Give the
            planned acceleration if `ddq` also contains the correction of an error. With `planned`,
            the correction acts through B(q) of the fixed base, with the same stiffness as on a
            fixed base. The error obeys `D dde + B (Kd de + Kp e) = 0` with the inertia D on the
            free base. The error is stable, because B and D are positive definite.
        """
        if not isinstance(base, FreeBaseMotion):
            return self._recursion(q, dq, ddq, base)[6:]
        forces = self.whole.forces(q, dq, ddq, base.angular_velocity)
        inverse, coupling = self.whole.response(q)
        wrench = base.wrench - forces[:6]
        if planned is not None:
            wrench = wrench + coupling @ (ddq - planned)
        answer = inverse @ wrench
        torques: Array = forces[6:] + self._felt(base, answer) @ coupling
        return torques

    def bias(self, q: Array, dq: Array, base: BaseMotion | None = None) -> Array:
        """Return h(q, dq, base), the joint torques (n,) [Nm] at zero joint acceleration."""
        return self.inverse(q, dq, self._zero, base)

    def gravity(self, q: Array, base: BaseMotion | None = None, ddq: Array | None = None) -> Array:
        """Return the joint torques (n,) [Nm] that hold the arm at rest relative to its base.

        On a still base this is g(q) of thesis (2.5). The joint acceleration `ddq` (n,) [rad/s^2]
        moves a base that responds, but adds no inertial torque to the result.
        """
        if not isinstance(base, FreeBaseMotion):
            return self._recursion(q, self._zero, self._zero, base)[6:]
        forces = self.whole.forces(q, self._zero, self._zero, base.angular_velocity)
        inverse, coupling = self.whole.response(q)
        wrench = base.wrench - forces[:6]
        if ddq is not None:
            wrench = wrench - coupling @ ddq
        torques: Array = forces[6:] + self._felt(base, inverse @ wrench) @ coupling
        return torques

    def inertia_matrix(self, q: Array, base: BaseMotion | None = None) -> Array:
        """Return the effective joint inertia (n, n) [kg m^2]: B(q) of thesis (2.5).

        On a base that responds, the inertia is smaller by the base's response. The weight of the
        response is limited to one, because no body has the inertia of a larger weight.
        """
        if not isinstance(base, FreeBaseMotion):
            return self.fixed.inertia_matrix(q)
        inverse, coupling = self.whole.response(q)
        share = np.minimum(base.share, 1.0)[:, np.newaxis]
        given = coupling.T @ (share * (inverse @ coupling))
        return self.fixed.inertia_matrix(q) - given

    def mobility_matrix(self, q: Array, base: BaseMotion | None = None) -> Array:
        """Return the inverse (n, n) [1/(kg m^2)] of the matrix from `inertia_matrix`.

        On a base whose response has a weight between zero and one, the result is a mean of the
        results for weights zero and one.
        """
        fixed = self.fixed.mobility_matrix(q)
        if not isinstance(base, FreeBaseMotion):
            return fixed
        share = min(1.0, float(base.share.min()))
        return fixed + share * (self.whole.mobility_matrix(q) - fixed)

    def mount_wrench(
        self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None = None
    ) -> Array:
        """Return the wrench of the base on the arm, about the base's origin in base axes.

        Returns
        -------
        (6,) ndarray
            Force [N], then moment [Nm].
        """
        return self._recursion(q, dq, ddq, base)[:6]

    def reaction(
        self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None = None
    ) -> tuple[Array, Array]:
        """Return the arm's wrench on the drone during a motion, and its part due to gravity.

        The model assumes that only gravity and the drone act on the arm, so their wrench follows
        from the arm's motion. Contact of the arm with other bodies is not included. Without
        `rotor_inertia`, the motors' rotors are assumed to rotate with their links: the moment
        `J_m ddq / k_g` that accelerates a rotor, some 10 mNm, is neglected.

        Parameters
        ----------
        q, dq, ddq, base
            As for `inverse`.

        Returns
        -------
        wrench, static : (6,) ndarray
            Force [N] and moment [Nm] about the base's origin, in base axes. `static` is the wrench
            of gravity with all bodies at rest.
        """
        mass, com, _ = self.composite_inertia(q)
        weight = mass * (self.still if base is None else base).gravity
        static = np.concatenate([weight, np.cross(com, weight)])
        return -self.mount_wrench(q, dq, ddq, base), static

    def composite_inertia(self, q: Array) -> tuple[float, Array, Array]:
        """Return mass, centre of mass and inertia as `WholeBodyDynamics.composite_inertia` does."""
        return self._arm.composite_inertia(q)

    def _felt(self, base: FreeBaseMotion, answer: Array) -> Array:
        """Return the base's acceleration (6,), including the base's response to the arm."""
        felt = self._acceleration
        felt[:3] = base.specific_force
        felt[3:] = base.angular_acceleration
        return felt + base.share * answer

    def _recursion(self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None) -> Array:
        motion = self.still if base is None else base
        felt = self._acceleration
        felt[:3] = motion.specific_force
        felt[3:] = motion.angular_acceleration
        return self._arm.forces(q, dq, ddq, motion.angular_velocity, felt)
