"""What the arm does to the drone."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aerarm_ros.control.base.base_motion import BaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.description.robot import Robot

Array = npt.NDArray[np.float64]


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
