"""Where gravity points: a base is never quite as level as it is said to be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.model_choice.simple_fit import SharedColumns, SimpleFit
from aerarm_ros.identification.model_choice.standard_errors import block_sums
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.model.regressor import Regressor

Array = npt.NDArray[np.float64]

_SPREAD = 0.02  # [rad] to which a base stands level before any data
_ROUNDS = 2  # the torque of a tilt depends on the links' masses, and the other way round
# A tilt is believed if it lowers the held-out squared error by this share, and in most of the
# motion: on measured robots that stand level it gains 0.4 % at most, on others 12 % and more.
_WORTHWHILE = 0.05


@dataclass(frozen=True, eq=False)
class GravityDirection:
    """Gravity as stated and as the motion shows it.

    Attributes
    ----------
    stated, used : (3,) ndarray
        In the base frame [m/s^2]; equal where the data show no tilt.
    error : float
        Held-out squared torque error with the tilt that fits best, relative to that without.
    """

    stated: Array
    used: Array
    error: float = 1.0

    @property
    def tilt(self) -> float:
        """Angle between the two [rad]."""
        across = np.linalg.norm(np.cross(self.stated, self.used))
        return float(np.arctan2(across, self.stated @ self.used))


def find_gravity(
    robot: Robot, bags: Sequence[SampleColumns], cad: ArmParameters
) -> GravityDirection:
    """Look for the tilt of the base that explains the torque better, and test it on held-out parts.

    Gravity turns by the angle v: `g + v x g`, whose torque is linear in v for given links. Half a
    degree on an arm of 10 kg is a torque of 0.4 Nm about its first axis, which otherwise ends up in
    the links' parameters: its joints then seem to have less inertia than their links.

    Parameters
    ----------
    robot : Robot
        With gravity as stated.
    bags : sequence of SampleColumns
        To identify from, of this robot.
    cad : ArmParameters
    """
    stated = np.array(robot.gravity_in_base)
    size = float(np.linalg.norm(stated))
    if size == 0.0:
        return GravityDirection(stated, stated)
    plain = SimpleFit(bags, cad)
    axes = np.linalg.svd(stated[None] / size)[2][1:]
    links = cad.inertial.ravel()
    for _ in range(_ROUNDS):
        shared = [_columns(robot, bag, axes, links) for bag in bags]
        tilted = SimpleFit(bags, cad, shared)
        links, angles = np.split(tilted.theta[: 10 * robot.n + 2], [10 * robot.n])
    blocks = [bag.samples.block for bag in bags]
    before, after = (block_sums(blocks, fit.residuals()) for fit in (plain, tilted))
    error = float(after.sum() / before.sum()) if before.sum() > 0.0 else 1.0
    if error > 1.0 - _WORTHWHILE or 2 * np.sum(after < before) <= len(before):
        return GravityDirection(stated, stated, error)
    used = stated + np.cross(angles @ axes, stated)
    return GravityDirection(stated, used * (size / np.linalg.norm(used)), error)


def _columns(robot: Robot, bag: SampleColumns, axes: Array, links: Array) -> SharedColumns:
    """Return the torque of a tilt about each axis, filtered [Nm/rad]."""
    samples = bag.samples
    rest = np.zeros_like(samples.q)
    parts = []
    for axis in axes:
        turned = Regressor(robot.with_gravity(np.cross(axis, robot.gravity_in_base)))
        parts.append(turned.stack_rigid(samples.q, rest, rest) @ links)
    columns = samples.coarse_filter(np.stack(parts, axis=2))
    return SharedColumns(columns, np.full(len(axes), _SPREAD))
