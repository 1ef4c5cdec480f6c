"""Inverse dynamics of an arm whose base moves."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import Dynamics, carry

Array = npt.NDArray[np.float64]


class MovingBaseDynamics:
    """`B(q) ddq + h(q, dq, base) = xi`: thesis (2.5) seen from a moving base.

    The arm is put on a free joint without gravity whose acceleration is the base's specific
    force: by the principle of equivalence the arm feels nothing else of attitude and gravity,
    so neither the base's position, velocity nor attitude enters. One recursion yields the
    joint torques and the wrench at the mount. On a still base it is the fixed-base model.

    Made for a 1 kHz loop: arguments are not checked. An instance holds working memory: use
    one a thread.

    Parameters
    ----------
    robot : Robot
    rotor_inertia : float or (n,) array_like
        Rotor inertia at the joints [kg m^2].

    Attributes
    ----------
    fixed : Dynamics
        The same arm on a fixed base; B and C do not depend on the base's motion.
    still : BaseMotion
        A base at rest under the robot's own gravity, used where no motion is given.

    Raises
    ------
    ValueError
        If a rotor inertia is negative or not finite, or their number isn't n.
    """

    def __init__(self, robot: Robot, rotor_inertia: npt.ArrayLike = 0.0) -> None:
        self.robot = robot
        self.n = robot.n
        self.fixed = Dynamics(robot, rotor_inertia)
        self.still = BaseMotion.still(robot.gravity_in_base)
        self._model = _on_free_joint(robot)
        self._model.armature = np.concatenate([np.zeros(6), self.fixed.rotor_inertia])
        self._data = self._model.createData()
        self._last_link = pin.Inertia(self._model.inertias[self._model.njoints - 1])
        self._q = pin.neutral(self._model)
        self._dq = np.zeros(6 + robot.n)
        self._ddq = np.zeros(6 + robot.n)
        self._zero = np.zeros(robot.n)

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a body to the last link, in place of one added before.

        Parameters
        ----------
        payload : (10,) array_like
            Inertial parameters (3.3) in the frame of the last link's joint; zeros for nothing.

        Raises
        ------
        ValueError
            If no body has them; nothing is changed then.
        """
        carry(self._model, self._last_link, payload)
        self.fixed.carry(payload)

    def inverse(self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None = None) -> Array:
        """Return the joint torques xi of a motion, (n,) [Nm]; rotors included, friction not.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            [rad], [rad/s], [rad/s^2]
        base : BaseMotion, optional
            Default: `still`.
        """
        return self._recursion(q, dq, ddq, base)[6:]

    def bias(self, q: Array, dq: Array, base: BaseMotion | None = None) -> Array:
        """Return h(q, dq, base), (n,) [Nm]: the torques that leave `ddq` zero."""
        return self._recursion(q, dq, self._zero, base)[6:]

    def gravity(self, q: Array, base: BaseMotion | None = None) -> Array:
        """Return the torques [Nm] that hold the arm at rest on the base, (n,).

        On a still base this is g(q) of thesis (2.5).
        """
        return self._recursion(q, self._zero, self._zero, base)[6:]

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
        """Return mass, centre of mass and inertia of the whole arm, in base axes.

        Returns
        -------
        mass : float
            [kg]
        com : (3,) ndarray
            From the base frame's origin [m].
        inertia : (3, 3) ndarray
            About the centre of mass [kg m^2].
        """
        self._q[7:] = q
        pin.crba(self._model, self._data, self._q)
        body = self._data.Ycrb[1]
        return float(body.mass), np.array(body.lever), np.array(body.inertia)

    def _recursion(self, q: Array, dq: Array, ddq: Array, base: BaseMotion | None) -> Array:
        motion = self.still if base is None else base
        self._q[7:] = q
        velocity, acceleration = self._dq, self._ddq
        # The base's linear velocity is left at zero: only accelerations are felt.
        velocity[3:6] = motion.angular_velocity
        velocity[6:] = dq
        acceleration[:3] = motion.specific_force
        acceleration[3:6] = motion.angular_acceleration
        acceleration[6:] = ddq
        torques: Array = pin.rnea(self._model, self._data, self._q, velocity, acceleration)
        return torques


def _on_free_joint(robot: Robot) -> Any:
    """Return the robot's model with a free joint between world and base, without gravity."""
    source = robot.model
    model = pin.Model()
    parent = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), 'base')
    model.appendBodyToJoint(parent, source.inertias[0], pin.SE3.Identity())
    for index in range(1, source.njoints):
        parent = model.addJoint(
            parent, source.joints[index], source.jointPlacements[index], source.names[index]
        )
        model.appendBodyToJoint(parent, source.inertias[index], pin.SE3.Identity())
    model.gravity = pin.Motion.Zero()
    return model
