"""Combined dynamics of arm and vehicle, modelled as an arm on a free joint."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot
from aerarm_ros.model.dynamics import LastLink, checked_rotor_inertia
from aerarm_ros.model.inertia import checked_body
from aerarm_ros.motion.signals import Array


class WholeBodyDynamics:
    """Rigid dynamics of an arm with n joints on a free base.

    ::

        [ M_bb  M_bj ] [ s   ]   [ c_b ]   [ w   ]
        [ M_jb  M_jj ] [ ddq ] + [ c_j ] = [ tau ]

    Quantities of the base refer to the origin and axes of the arm's base frame, linear before
    angular: its acceleration `s`, and the wrench `w` of the vehicle's rotors. The linear part of
    `s` is the specific force (acceleration minus gravity). Gravity and attitude act only through
    the specific force, so they do not appear in the equations, and `c` contains only Coriolis and
    centrifugal forces. The bias force `h` of the usual notation, which includes gravity g, is `c
    - M (g, 0)`.

    Gyroscopic effects of motors and propellers are neglected. Arguments are not checked. An
    instance has working memory, so use one per thread.

    Parameters
    ----------
    robot : Robot
        Robot model of the arm.
    rotor_inertia : float or (n,) array_like
        Inertia of the motors' rotors at the joints [kg m^2], on the diagonal of M_jj.
    carrier : (10,) array_like, optional
        Inertial parameters (3.3) of the vehicle, in the arm's base frame; by default without a
        vehicle, so that M_bb is the inertia of the arm alone.

    Attributes
    ----------
    mass : float
        Total mass [kg].

    Raises
    ------
    ValueError
        If a rotor inertia is negative or not finite, their number is not n, or the vehicle's
        parameters are physically impossible.
    """

    def __init__(
        self, robot: Robot, rotor_inertia: npt.ArrayLike = 0.0, carrier: npt.ArrayLike | None = None
    ) -> None:
        self.robot = robot
        self.n = robot.n
        self._model = _on_free_joint(robot)
        rotors = checked_rotor_inertia(rotor_inertia, robot.n)
        self._model.armature = np.concatenate([np.zeros(6), rotors])
        if carrier is not None:
            whole = self._model.inertias[1].toDynamicParameters() + checked_body('carrier', carrier)
            self._model.inertias[1] = pin.Inertia.FromDynamicParameters(whole)
        self.mass = float(pin.computeTotalMass(self._model))
        self._data = self._model.createData()
        self._last_link = LastLink(self._model)
        self._q = pin.neutral(self._model)
        self._dq = np.zeros(6 + self.n)
        self._ddq = np.zeros(6 + self.n)

    def carry(self, payload: npt.ArrayLike) -> None:
        """Add a payload to the last link, see `Dynamics.carry`."""
        self._last_link.carry(payload)
        self.mass = float(pin.computeTotalMass(self._model))

    def inertia_matrix(self, q: Array) -> Array:
        """Return the inertia matrix M(q), (6 + n, 6 + n), symmetric, including rotors."""
        self._q[7:] = q
        return np.asarray(pin.crba(self._model, self._data, self._q))

    def forces(
        self,
        q: Array,
        dq: Array,
        ddq: Array,
        angular_velocity: Array,
        acceleration: Array | float = 0.0,
    ) -> Array:
        """Return the wrench on the base and the joint torques that produce a motion.

        With zero `acceleration` and `ddq` the result is c; with `ddq` alone it is `M_bj ddq + c_b`
        and `M_jj ddq + c_j`.

        Parameters
        ----------
        q, dq, ddq : (n,) ndarray
            Joint positions [rad], velocities [rad/s], accelerations [rad/s^2].
        angular_velocity : (3,) ndarray
            Angular velocity of the base [rad/s].
        acceleration : (6,) ndarray or float
            Specific force [m/s^2] and angular acceleration [rad/s^2] of the base.

        Returns
        -------
        (6 + n,) ndarray
            Force [N] and moment [Nm] on the base, and joint torques [Nm].
        """
        velocity, second = self._dq, self._ddq
        self._q[7:] = q
        # The base's linear velocity has no effect and stays zero.
        velocity[3:6] = angular_velocity
        velocity[6:] = dq
        second[:6] = acceleration
        second[6:] = ddq
        return np.asarray(pin.rnea(self._model, self._data, self._q, velocity, second))

    def response(self, q: Array) -> tuple[Array, Array]:
        """Return `M_bb^-1` (6, 6) and `M_bj` (6, n), from which the base's acceleration follows.

        Under the wrench w the base accelerates by `s = M_bb^-1 (w - c_b - M_bj ddq)`. The inverse
        is that of one rigid body, in closed form.
        """
        coupling = self.inertia_matrix(q)[:6, 6:]
        return np.asarray(self._data.Ycrb[1].inverse()), coupling

    def reduced_inertia(self, q: Array) -> Array:
        """Return the joint inertia on a free base, `M_jj - M_jb M_bb^-1 M_bj`, (n, n)."""
        return self._reduced(q)[0]

    def mobility_matrix(self, q: Array) -> Array:
        """Return the inverse of the joint inertia on a free base, (n, n) [1/(kg m^2)]."""
        self._q[7:] = q
        return np.array(pin.computeMinverse(self._model, self._data, self._q)[6:, 6:])

    def feedback_gain(self, q: Array) -> float:
        """Return the loop gain that arises if torques depend on the measured base acceleration.

        Joint torques `M_jb s`, computed from a measured base acceleration `s`, accelerate the
        joints by `D^-1 M_jb s`, where D is the reduced inertia. The joints in turn accelerate the
        base by `G s = M_bb^-1 M_bj D^-1 M_jb s` in the direction opposite to `s`. The gain is the
        largest eigenvalue of G, whose eigenvalues are real and non-negative.
        """
        # The eigenvalues of a product do not depend on the order of its two factors.
        gain = np.linalg.solve(*self._reduced(q))
        return float(np.max(np.linalg.eigvals(gain).real))

    def _reduced(self, q: Array) -> tuple[Array, Array]:
        """Return the joint inertia on a free base, and its difference to that on a fixed base."""
        matrix = self.inertia_matrix(q)
        coupling = matrix[:6, 6:]
        lost = coupling.T @ (self._data.Ycrb[1].inverse() @ coupling)
        return np.asarray(matrix[6:, 6:] - lost), np.asarray(lost)

    def composite_inertia(self, q: Array) -> tuple[float, Array, Array]:
        """Return mass, centre of mass and inertia of arm and vehicle, in base axes.

        Returns
        -------
        mass : float
            Total mass [kg].
        com : (3,) ndarray
            Centre of mass from the base frame's origin [m].
        inertia : (3, 3) ndarray
            Inertia tensor about the centre of mass [kg m^2].
        """
        self.inertia_matrix(q)
        body = self._data.Ycrb[1]
        return float(body.mass), np.array(body.lever), np.array(body.inertia)

    def centroidal_momentum(self, q: Array, dq: Array, twist: Array) -> Array:
        """Return the linear momentum, and the angular momentum about the centre of mass, (6,).

        The result is along the base's axes, without the spin of the rotors.

        Parameters
        ----------
        q, dq : (n,) ndarray
            Joint positions [rad] and velocities [rad/s].
        twist : (6,) ndarray
            Velocity of the base's origin [m/s] and angular velocity [rad/s], in base axes.
        """
        self._q[7:] = q
        velocity = np.concatenate([twist, dq])
        momentum = pin.computeCentroidalMomentum(self._model, self._data, self._q, velocity)
        return np.array(momentum.vector)


def _on_free_joint(robot: Robot) -> Any:
    """Return a model of the robot with a free joint between world and base, without gravity."""
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
