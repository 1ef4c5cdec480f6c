"""Result of an identification, from which its files and its report are written."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.arm_parameters import ArmParameters
from aerarm_ros.identification.assessment import BagAssessment, BagDemand
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.model_choice.filter_choice import (
    EffortDelay,
    FilterChoice,
    GravityDirection,
)
from aerarm_ros.identification.model_choice.model_choice import Comparison
from aerarm_ros.identification.regression.base_parameters import BaseParameters
from aerarm_ros.identification.regression.model_fit import ModelFit
from aerarm_ros.identification.regression.regression import SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.solvers import RECOMMENDED

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
