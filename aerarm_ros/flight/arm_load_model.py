"""The arm's load on its drone, from the motion of its joints."""

import numpy as np

from aerarm_ros.description.robot import Robot
from aerarm_ros.flight.arm_load import ArmLoad
from aerarm_ros.model.cross_product import cross
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.joint_reference import JointReference

_STILL = np.zeros(3)


class ArmLoadModel:
    """Computes an `ArmLoad` from the motion of the joints.

    Parameters
    ----------
    robot : Robot
        With everything the arm adds to the drone; its gravity is that of a level drone.

    Attributes
    ----------
    dynamics : WholeBodyDynamics
        The model, to be told of a payload.
    """

    def __init__(self, robot: Robot) -> None:
        self.dynamics = WholeBodyDynamics(robot)
        self._gravity = np.array(robot.gravity_in_base, dtype=float)

    def evaluate(self, motion: JointReference) -> ArmLoad:
        """Return the load of a motion of n joints at one instant."""
        mass, com, inertia = self.dynamics.composite_inertia(motion.q)
        force = mass * self._gravity
        weight = np.concatenate([force, cross(com, force)])
        return ArmLoad(mass, com, inertia, weight, -self.dynamics.forces(*motion, _STILL)[:6])
