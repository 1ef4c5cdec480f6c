"""The most that gravity can ask of a joint, however the arm's base is turned."""

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.robot import Robot

Array = npt.NDArray[np.float64]

GRAVITY = 9.81
"""[m/s^2]"""
_POSTURES = 500


def largest_gravity_load(robot: Robot) -> Array:
    """Return the largest gravity torques over all postures and directions of gravity.

    The directions are taken exactly, the postures as a sample between the joints' limits.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    (n,) ndarray
        [Nm], none negative.
    """
    model = robot.model.copy()
    data = model.createData()
    random = np.random.default_rng(0)
    postures = random.uniform(*robot.posture_range, (_POSTURES, robot.n))
    along_axes = []
    for direction in np.eye(3):
        model.gravity.linear = GRAVITY * direction
        along_axes.append([pin.computeGeneralizedGravity(model, data, q).copy() for q in postures])
    # A torque is linear in gravity: its largest value is the norm of the three.
    largest: Array = np.linalg.norm(along_axes, axis=0).max(axis=0)
    return largest
