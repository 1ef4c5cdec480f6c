"""How far simulated arms stray from a recorded motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.samples import Samples
from aerarm_ros.identification.parameters.joint_model import JointModel
from aerarm_ros.identification.rollout.rollout import Rollout
from aerarm_ros.identification.rollout.rollout_windows import RolloutWindows

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RolloutError:
    """Of one set of parameters on one bag.

    Attributes
    ----------
    bag, solver : str
    seconds : float
        Length of a window [s].
    windows : int
    per_joint : (n,) ndarray
        Root mean square of the position's error along the windows [rad]; infinite where the
        simulated arm runs away.
    total : float
        The same of all joints, as a share of how far they move within the windows [%].
    """

    bag: str
    solver: str
    seconds: float
    windows: int
    per_joint: Array
    total: float


def rollout_error(
    robot: Robot, model: JointModel, bag: Samples, estimates: Mapping[str, Array]
) -> list[RolloutError]:
    """Simulate a bag's windows with the parameters of each solver.

    Parameters
    ----------
    robot : Robot
    model : JointModel
    bag : Samples
    estimates : mapping
        Solver to parameters (p,).

    Returns
    -------
    list of RolloutError
        Empty if no window of the bag has all torques.
    """
    windows = RolloutWindows.of(robot, [bag])
    if not windows.count:
        return []
    rollout = Rollout(model, windows)
    moved = windows.q[:, 1:] - windows.q[:, :1]
    size = max(float(np.linalg.norm(moved)), 1e-12)
    errors = []
    for solver, theta in estimates.items():
        left = rollout.positions(theta) - windows.q[:, 1:]
        squares = np.where(np.isfinite(left), left, np.inf) ** 2
        errors.append(
            RolloutError(
                bag.name,
                solver,
                windows.dt * moved.shape[1],
                windows.count,
                np.sqrt(squares.mean(axis=(0, 1))),
                100.0 * float(np.sqrt(squares.sum())) / size,
            )
        )
    return errors
