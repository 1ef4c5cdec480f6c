"""Result of an identification, from which its files and its report are written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.config_reader import ConfigError, read_plain
from aerarm_ros.description.robot import Robot
from aerarm_ros.description.urdf_document import CALIBRATED
from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.assessment import BagAssessment, BagDemand, ResidualTrend
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.errors import IdentificationError, readable
from aerarm_ros.identification.model_choice.filter_choice import (
    EffortDelay,
    FilterChoice,
    GravityDirection,
)
from aerarm_ros.identification.model_choice.model_choice import Comparison
from aerarm_ros.identification.regression.base_parameters import BaseParameters
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.identification.residual_split import ResidualSplit
from aerarm_ros.identification.rollout import RolloutError
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.solvers import RECOMMENDED
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # only for type annotations
    from aerarm_ros.energy.energy_model import EnergyBalance

# a parameter with a smaller fraction of information from data counts as determined by the prior
_UNKNOWN = 0.01


@dataclass(frozen=True, eq=False)
class Solution:
    """Estimate of one solver with its torque errors on all bags."""

    estimate: Estimate
    identification: list[BagAssessment]
    validation: list[BagAssessment]


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """Result of `identify`.

    Attributes
    ----------
    gravity : GravityDirection or None
        Direction of gravity estimated from the data; None if not requested.
    delay : EffortDelay or None
        Estimated delay of efforts; None if its estimation was not requested.
    conditioner : Conditioner
        Conditioner with cut-off, period, harmonics and corrected delays.
    filter_choice : FilterChoice
        Chosen filter of the kinematics, with the identification bags.
    validation : list of SampleColumns
        Validation bags.
    thesis_base, used_base : BaseParameters
        `thesis_base`: base parameters of links, viscous and Coulomb friction. `used_base`: base
        parameters of all fitted columns.
    fit : ModelFit
        Fit with the regression that all solvers use.
    comparisons : list of Comparison
        Friction models that were tried for each joint.
    solutions : dict of str to Solution
        Solution of each solver.
    left_out : list of str
        Names of columns that were removed because their coefficient was at its bound 0.
    demands : list of BagDemand
        Motion range and excitation of each identification bag, then of each validation bag.
    trends : list of ResidualTrend
        Change of the residual during each identification bag.
    splits : list of ResidualSplit
        Causes of the residual of each validation bag, or of the identification bags without any.
    rollouts : list of RolloutError
        Error of the arm simulated with each solver's parameters on each bag; empty if not
        requested.
    """

    robot: Robot
    cad: ArmParameters
    conditioner: Conditioner
    gravity: GravityDirection | None
    delay: EffortDelay | None
    filter_choice: FilterChoice
    validation: list[SampleColumns]
    thesis_base: BaseParameters
    used_base: BaseParameters
    fit: ModelFit
    comparisons: list[Comparison]
    solutions: dict[str, Solution]
    left_out: list[str]
    demands: list[BagDemand]
    trends: list[ResidualTrend]
    splits: list[ResidualSplit]
    rollouts: list[RolloutError]
    warnings: list[str]

    @property
    def identification(self) -> list[SampleColumns]:
        """Bags used for identification."""
        return self.filter_choice.bags

    @property
    def recommended(self) -> Solution:
        """Recommended solution, which is physically consistent."""
        return self.solutions[RECOMMENDED]

    @property
    def only_prior(self) -> tuple[str, ...]:
        """Names of the parameters of the recommended estimate that the data barely determine."""
        determined = self.recommended.estimate.determined
        if determined is None:
            return ()
        pairs = zip(self.fit.model.columns, determined, strict=True)
        return tuple(name for name, share in pairs if share < _UNKNOWN)

    @property
    def only_in_sums(self) -> tuple[str, ...]:
        """Names of parameters of which the data determine only sums with other parameters."""
        base = self.used_base
        mixed = base.combination != 0.0
        index = [*base.independent[mixed.any(axis=1)], *base.dependent[mixed.any(axis=0)]]
        return tuple(base.columns[i] for i in sorted(index))

    @property
    def base_deviations(self) -> npt.NDArray[np.float64]:
        """Standard deviations (r,) of the base parameters, from the data without the prior."""
        weights = self.fit.noise.information_weights
        factor = self.fit.regression.system(weights).R[:, self.used_base.independent]
        scale = np.linalg.norm(factor, axis=0)
        inverse = np.linalg.pinv(factor / scale)
        return np.asarray(np.sqrt((inverse**2).sum(axis=1)) / scale)

    @property
    def base_prior_deviations(self) -> npt.NDArray[np.float64]:
        """Standard deviations (r,) of the base parameters in the prior."""
        base, std = self.used_base, self.fit.prior.std
        mixed = base.combination**2 @ std[base.dependent] ** 2
        return np.asarray(np.sqrt(std[base.independent] ** 2 + mixed))

    @property
    def samples(self) -> int:
        """Number of recorded samples in the identification bags."""
        return sum(bag.samples.recorded for bag in self.identification)


class Check(NamedTuple):
    """Comparison of one quantity of an identification result with its limit.

    Attributes
    ----------
    name : str
        Key of `LIMITS`.
    """

    name: str
    limit: float
    value: float
    passed: bool

    @property
    def text(self) -> str:
        """One line for a terminal."""
        verdict = 'passed' if self.passed else 'FAILED'
        return f'{verdict}  {self.name}: {self.value:.4g}, at most {self.limit:.4g}'


def _bags(result: IdentificationResult) -> list[BagAssessment]:
    """Return the validation bags, or the identification bags if there are none."""
    return result.recommended.validation or result.recommended.identification


def _largest(
    values: Callable[[BagAssessment], npt.ArrayLike],
) -> Callable[[IdentificationResult], float]:
    return lambda result: float(
        np.nanmax([np.nanmax(np.asarray(values(bag))) for bag in _bags(result)])
    )


LIMITS: dict[str, Callable[[IdentificationResult], float]] = {
    'filtered': _largest(lambda bag: bag.filtered),
    'filtered_measured': _largest(lambda bag: bag.filtered_measured),
    'raw': _largest(lambda bag: bag.raw),
    'joint_filtered': _largest(lambda bag: bag.per_joint_filtered),
    'joint_raw': _largest(lambda bag: bag.per_joint_raw),
    'torque_deviation': lambda result: max(float(d.uncertainty.max()) for d in result.demands),
    'condition_number': lambda result: result.thesis_base.condition_number,
    'inconsistent': lambda result: float(not result.recommended.estimate.physically_consistent),
    'tilt': lambda result: float(np.degrees(result.gravity.tilt)) if result.gravity else 0.0,
    'warnings': lambda result: float(len(result.warnings)),
}
"""Functions that compute a quantity of the result, by the name that a limit file uses.

Largest torque errors of the validation bags [%], standard deviation of the predicted torque due to
parameter uncertainty [Nm], condition number (5.2), consistency (0 or 1), tilt [deg], and number of
warnings.
"""


def read_limits(path: Path) -> dict[str, float]:
    """Read the limits of an identification result from a YAML file.

    Raises
    ------
    IdentificationError
        If the file cannot be read, or contains anything but numbers for keys of `LIMITS`.
    """
    try:
        with readable(path):
            document = read_plain(path)
    except ConfigError as error:
        raise IdentificationError(f'{path}: {" ".join(str(error).split())}') from None
    known = f'limits are {", ".join(LIMITS)}'
    if not isinstance(document, dict) or not document:
        raise IdentificationError(f'{path}: no limits: {known}')
    unknown = [str(key) for key in document if key not in LIMITS]
    if unknown:
        raise IdentificationError(f'{path}: no limit {", ".join(unknown)}: {known}')
    for key, value in document.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not np.isfinite(value) or value < 0.0:
            raise IdentificationError(f'{path}: {key} = {value} must be a non-negative number')
    return {key: float(value) for key, value in document.items()}


def judge(result: IdentificationResult, limits: dict[str, float]) -> list[Check]:
    """Compare an identification result with limits.

    Parameters
    ----------
    limits : dict
        Largest allowed value for each key of `LIMITS`.
    """
    values = ((name, limit, LIMITS[name](result)) for name, limit in limits.items())
    return [Check(name, limit, value, value <= limit) for name, limit, value in values]


def bag_energies(config: ArmConfig, result: IdentificationResult) -> dict[str, EnergyBalance]:
    """Return the energy balance of each bag by name; samples at the bag's ends are omitted.

    The torque is the filtered measured torque. Inertial and friction torques are those of the
    recommended estimate.

    Parameters
    ----------
    config : ArmConfig
        Configuration with motor resistances and power stage. The result is empty if the
        configuration belongs to another arm.
    """
    from aerarm_ros.energy.energy_model import EnergyModel

    robot, solution = result.robot, result.recommended
    if config.joint_names != robot.joint_names:
        return {}
    estimate = solution.estimate
    theta = dict(zip(estimate.model.columns, estimate.theta.tolist(), strict=True))
    rotors = [max(theta.get(f'Ja_{name}', 0.0), 0.0) for name in robot.joint_names]
    model = EnergyModel(config, robot.with_inertial_parameters(estimate.inertial), rotors)
    balances = {}
    bags = [*result.identification, *result.validation]
    assessed = [*solution.identification, *solution.validation]
    for bag, assessment in zip(bags, assessed, strict=True):
        samples, motion, kept = bag.samples, bag.motion, bag.samples.kept
        torques = model.torques(motion.q, motion.dq, motion.ddq)
        rigid, weight = (bag.whole(torque)[kept] for torque in torques)
        friction = assessment.prediction.filtered[kept] - rigid
        dt = float(np.median(np.diff(samples.time)))
        balances[assessment.bag] = model.split(
            dt, samples.dq[kept], samples.tau[kept], rigid - weight, weight, friction
        )
    return balances


_MOST = 300  # largest number of samples used


def is_calibrated(robot: Robot) -> bool:
    """Return whether the calibrator has written the URDF of a robot."""
    return CALIBRATED in robot.urdf_text


def torque_error_per_millimetre(robot: Robot, q: Array, dq: Array, ddq: Array) -> float:
    """Return the relative torque error [%] that a displacement of the joints by 1 mm causes.

    Each joint except the first is displaced along each axis of its parent link. The errors are
    independent, so their squares add up. The inertial parameters stay unchanged, although an
    identification would absorb a part of the error.

    Parameters
    ----------
    q, dq, ddq : (M, n) ndarray
        Joint motion [rad], [rad/s], [rad/s^2].
    """
    step = max(1, len(q) // _MOST)
    motion = list(zip(q[::step], dq[::step], ddq[::step], strict=True))
    nominal = _torques(robot.model, motion)
    total = float(np.sum(nominal**2))
    if total == 0.0:
        return 0.0
    squares = 0.0
    for joint in range(2, robot.model.njoints):
        for axis in np.eye(3):
            model = robot.model.copy()
            shift = pin.SE3(np.eye(3), 1e-3 * axis)
            model.jointPlacements[joint] = shift * model.jointPlacements[joint]
            squares += float(np.sum((_torques(model, motion) - nominal) ** 2))
    return 100.0 * float(np.sqrt(squares / total))


def geometry_text(result: IdentificationResult) -> str:
    """Return a text on whether the geometry is calibrated, and the possible torque error if not."""
    robot = result.robot
    if is_calibrated(robot):
        return 'The geometry of the URDF is calibrated.'
    samples = result.identification[0].samples
    identified = robot.with_inertial_parameters(result.recommended.estimate.inertial)
    cost = torque_error_per_millimetre(identified, samples.q, samples.dq, samples.ddq)
    return (
        'The geometry of the URDF was not calibrated. An error of 1 mm per axis at each joint '
        f'changes the torque of the links by {cost:.2g} %; the identified parameters compensate a '
        'part of this change. Run the calibrator to measure the geometry.'
    )


def _torques(model: object, motion: list[tuple[Array, Array, Array]]) -> Array:
    data = model.createData()  # type: ignore[attr-defined]
    return np.array([pin.rnea(model, data, *state).copy() for state in motion])
