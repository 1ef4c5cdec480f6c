"""Inverse dynamics of an arm whose base moves, or answers the arm."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.free_base_estimator import FreeBaseMotion
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import Array


class MovingBaseDynamics:
    """`B(q) ddq + h(q, dq, base) = xi`: thesis (2.5) seen from a moving base.

    A base that is moved: the arm is put on a free joint without gravity whose acceleration is the
    base's specific force, and one recursion yields the joint torques and the wrench at the mount.
    On a still base it is the fixed-base model.

    A base that answers (`FreeBaseMotion`): its acceleration follows from the rotors' wrench and
    from the joints' acceleration, and is `BaseMotion`'s own besides::

        s = s_0 + share M_bb^-1 (w - c_b - M_bj ddq)
        xi = M_jb s + M_jj ddq + c_j

    so that B becomes `M_jj - share M_jb M_bb^-1 M_bj`; see `WholeBodyDynamics`.

    Made for a 1 kHz loop: arguments are not checked. An instance holds working memory: use
    one a thread.

    Parameters
    ----------
    robot, rotor_inertia, carrier
        As for `WholeBodyDynamics`; the carrier is that of a base that answers.

    Attributes
    ----------
    fixed : Dynamics
        The same arm on a fixed base; B and C do not depend on the base's motion.
    whole : WholeBodyDynamics
        Arm and carrier.
    still : BaseMotion
        A base at rest under the robot's own gravity, used where no motion is given.

    Raises
    ------
    ValueError
        As `WholeBodyDynamics`.
    """

    def __init__(
        self,
        robot: Robot,
        rotor_inertia: npt.ArrayLike = 0.0,
        carrier: npt.ArrayLike | None = None,
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
        """Add a body to the last link, see `Dynamics.carry`; nothing is changed if it raises."""
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
        """Return the joint torques xi of a motion, (n,) [Nm]; rotors included, friction not.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            [rad], [rad/s], [rad/s^2]
        base : BaseMotion, optional
            Default: `still`.
        planned : (n,) ndarray, optional
            What a base that answers is expected to answer [rad/s^2], `ddq` if not given. With
            what is planned here and what corrects an error in `ddq` too, `xi` changes with the
            correction by B(q) of the fixed base: the joints are as stiff as there, and their
            error obeys `D dde + B (Kd de + Kp e) = 0` with D the inertia on the free base,
            which is stable because both are positive definite.
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
        """Return h(q, dq, base), (n,) [Nm]: the torques that leave `ddq` zero."""
        return self.inverse(q, dq, self._zero, base)

    def gravity(self, q: Array, base: BaseMotion | None = None, ddq: Array | None = None) -> Array:
        """Return the torques [Nm] that hold the arm at rest on the base, (n,).

        On a still base this is g(q) of thesis (2.5). A base that answers is moved by the joint
        acceleration `ddq` (n,) [rad/s^2], which itself costs nothing here.
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
        """Return the inertia (n, n) [kg m^2] that the joints feel: B(q) of thesis (2.5).

        On a base that answers it is smaller by the part with which the base gives way, believed
        in whole at most: beyond that it would be no inertia of any body.
        """
        if not isinstance(base, FreeBaseMotion):
            return self.fixed.inertia_matrix(q)
        inverse, coupling = self.whole.response(q)
        share = np.minimum(base.share, 1.0)[:, np.newaxis]
        given = coupling.T @ (share * (inverse @ coupling))
        return self.fixed.inertia_matrix(q) - given

    def mobility_matrix(self, q: Array, base: BaseMotion | None = None) -> Array:
        """Return the inverse of `inertia_matrix`, (n, n) [1/(kg m^2)].

        On a base that answers in part it is a mean of both ends.
        """
        fixed = self.fixed.mobility_matrix(q)
        if not isinstance(base, FreeBaseMotion):
            return fixed
        share = min(1.0, float(base.share.min()))
        return fixed + share * (self.whole.mobility_matrix(q) - fixed)

    def mount_wrench(
        self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None = None
    ) -> Array:
        """Return the wrench of the base on the arm at the base frame's origin, in its axes.

        Returns
        -------
        (6,) ndarray
            Force [N], then moment [Nm].
        """
        return self._recursion(q, dq, ddq, base)[:6]

    def composite_inertia(self, q: Array) -> tuple[float, Array, Array]:
        """Return mass, centre of mass and inertia of the arm, as `WholeBodyDynamics` does."""
        return self._arm.composite_inertia(q)

    def _felt(self, base: FreeBaseMotion, answer: Array) -> Array:
        """Return the acceleration of a base that answers, (6,)."""
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


class BaseReaction:
    """Wrench of the arm on the drone at the mount, and the arm's mass properties.

    The arm is moved by gravity and by the wrench of the drone alone, so the latter follows
    from the arm's own motion; contact of the arm with anything else is not seen. Rotors are
    taken to spin with their links: the moment `J_m ddq / k_g` with which a motor's rotor
    itself speeds up, some 10 mNm, is neglected.

    Parameters
    ----------
    robot : Robot
        With everything the arm adds to the drone, its base link included if it has inertia.

    Attributes
    ----------
    dynamics : MovingBaseDynamics
        The model, to be told of a payload.
    """

    class ArmReaction(NamedTuple):
        """All in the base frame's axes, moments about its origin.

        `wrench` (6,) is force [N] and moment [Nm] of the arm on the drone; `static` is the
        part due to gravity with everything at rest, `dynamic` the rest. `mass` [kg], `com`
        (3,) [m] and `inertia` (3, 3) about the centre of mass [kg m^2] are the arm's.
        """

        wrench: Array
        static: Array
        dynamic: Array
        mass: float
        com: Array
        inertia: Array

    def __init__(self, robot: Robot) -> None:
        self.dynamics = MovingBaseDynamics(robot)

    def evaluate(
        self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None = None
    ) -> 'BaseReaction.ArmReaction':
        """Return wrench and mass properties of a motion.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            [rad], [rad/s], [rad/s^2]
        base : BaseMotion, optional
            Default: still under the robot's own gravity.
        """
        wrench = -self.dynamics.mount_wrench(q, dq, ddq, base)
        mass, com, inertia = self.dynamics.composite_inertia(q)
        gravity = (self.dynamics.still if base is None else base).gravity
        weight = mass * gravity
        static = np.concatenate([weight, np.cross(com, weight)])
        return self.ArmReaction(wrench, static, wrench - static, mass, com, inertia)
