"""Everything an identification found, for files and report."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.assessment.assessment import BagAssessment
from aerarm_ros.identification.assessment.bag_demand import BagDemand
from aerarm_ros.identification.assessment.residual_trend import ResidualTrend
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.model_choice.effort_delay import EffortDelay
from aerarm_ros.identification.model_choice.filter_choice import FilterChoice
from aerarm_ros.identification.model_choice.gravity_direction import GravityDirection
from aerarm_ros.identification.model_choice.joint_model_selection import Comparison
from aerarm_ros.identification.parameters.arm_parameters import ArmParameters
from aerarm_ros.identification.regression.base_parameters import BaseParameters
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.sample_columns import SampleColumns
from aerarm_ros.identification.rollout.rollout_error import RolloutError
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.solvers import RECOMMENDED

_UNKNOWN = 0.01  # share from data below which a parameter is the prior's


@dataclass(frozen=True, eq=False)
class Solution:
    """An estimate and its torque errors."""

    estimate: Estimate
    identification: list[BagAssessment]
    validation: list[BagAssessment]


@dataclass(frozen=True, eq=False)
class IdentificationResult:
    """The outcome of `identify`.

    Attributes
    ----------
    robot : Robot
    cad : ArmParameters
    gravity : GravityDirection or None
        What the data say of it; None if it wasn't asked.
    delay : EffortDelay or None
        How late efforts are; None if it wasn't asked.
    conditioner : Conditioner
        Cut-off, period, harmonics, and the delays that were taken off.
    filter_choice : FilterChoice
        How the kinematics were cleaned; holds the identification bags.
    validation : list of SampleColumns
    thesis_base, used_base : BaseParameters
        Of links, viscous and Coulomb friction alone, and of all fitted columns.
    fit : ModelFit
        The regression behind the estimates.
    comparisons : list of Comparison
        Friction models tried.
    solutions : dict of str to Solution
        By solver.
    left_out : list of str
        Columns that the data had no use for: at their bound 0.
    demands : list of BagDemand
        What each bag, of identification and then of validation, asks of the model.
    trends : list of ResidualTrend
        What changed during each bag of identification.
    rollouts : list of RolloutError
        Of each solver on each bag, if they were asked for.
    warnings : list of str
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
    rollouts: list[RolloutError]
    warnings: list[str]

    @property
    def identification(self) -> list[SampleColumns]:
        """The bags identified from."""
        return self.filter_choice.bags

    @property
    def recommended(self) -> Solution:
        """The solution to use: the physically consistent one."""
        return self.solutions[RECOMMENDED]

    @property
    def only_prior(self) -> tuple[str, ...]:
        """Parameters of the recommended estimate that the data say next to nothing about."""
        determined = self.recommended.estimate.determined
        if determined is None:
            return ()
        pairs = zip(self.fit.model.columns, determined, strict=True)
        return tuple(name for name, share in pairs if share < _UNKNOWN)

    @property
    def only_in_sums(self) -> tuple[str, ...]:
        """Parameters that have an effect, but none of their own: the data determine a sum."""
        base = self.used_base
        mixed = base.combination != 0.0
        index = [*base.independent[mixed.any(axis=1)], *base.dependent[mixed.any(axis=0)]]
        return tuple(base.columns[i] for i in sorted(index))

    @property
    def base_deviations(self) -> npt.NDArray[np.float64]:
        """(r,) standard deviations of the base parameters by the data alone."""
        weights = self.fit.noise.information_weights
        factor = self.fit.regression.system(weights).R[:, self.used_base.independent]
        scale = np.linalg.norm(factor, axis=0)
        inverse = np.linalg.pinv(factor / scale)
        return np.asarray(np.sqrt((inverse**2).sum(axis=1)) / scale)

    @property
    def samples(self) -> int:
        """Recorded samples that the identification bags contributed."""
        return sum(bag.samples.recorded for bag in self.identification)
