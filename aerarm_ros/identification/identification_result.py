"""Result of an identification, from which its files and its report are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.filter_choice import EffortDelay, FilterChoice, GravityDirection
from aerarm_ros.identification.joint_model import ArmParameters
from aerarm_ros.identification.model_fit import BaseParameters, ModelFit, RegressionBank
from aerarm_ros.identification.regression import Prediction, SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.identification.solvers.solvers import RECOMMENDED
from aerarm_ros.motion.signals import Array

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
    gravity : GravityDirection
        Direction of gravity: estimated from the data, or as stated.
    delay : EffortDelay
        Estimated delay of efforts.
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
    gravity: GravityDirection
    delay: EffortDelay
    filter_choice: FilterChoice
    validation: list[SampleColumns]
    thesis_base: BaseParameters
    used_base: BaseParameters
    fit: ModelFit
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


# Tolerated excess of a motion over the identified range, relative to that range; filters cause
# small excesses.
_TOLERATED = 0.1
_HARDLY_MOVED = 10.0  # multiples of that range, above which a relative excess is not stated
# The model counts as extrapolating if the uncertainty of its torque grows by this factor and is
# significant.
_GROWTH = 3.0
_QUANTITIES = (('q', 'position'), ('dq', 'velocity'), ('ddq', 'acceleration'))


@dataclass(frozen=True, eq=False)
class BagDemand:
    """Excess of a bag's motion over the identification motion, and uncertainty of predicted torque.

    Attributes
    ----------
    beyond : (3, n) ndarray
        Excess of position, velocity and acceleration over the range of the identification motion,
        relative to that range; 0 inside.
    uncertainty : (n,) ndarray
        RMS over the motion of the predicted torque's standard deviation due to parameter
        uncertainty [Nm].
    """

    bag: str
    beyond: Array
    uncertainty: Array


def bag_demand(fit: ModelFit, bags: Sequence[SampleColumns], judged: SampleColumns) -> BagDemand:
    """Compare the motion of a bag with the motion of the identification bags.

    Parameters
    ----------
    fit : ModelFit
        Fit to `bags`.
    bags : sequence of SampleColumns
        Identification bags.
    judged : SampleColumns
        Bag to compare.
    """
    beyond = []
    for quantity, _ in _QUANTITIES:
        known = np.vstack([getattr(bag.samples, quantity)[bag.samples.kept] for bag in bags])
        compared = getattr(judged.samples, quantity)[judged.samples.kept]
        low, high = known.min(axis=0), known.max(axis=0)
        over = np.maximum(compared.max(axis=0) - high, low - compared.min(axis=0))
        beyond.append(np.maximum(over, 0.0) / np.maximum(high - low, 1e-9))
    terms = [term for _, term in fit.model.joint_columns]
    regression = RegressionBank([judged], terms, fit.inertial).regression(fit.model)
    variance = [
        np.einsum('ij,jk,ik', f[:, :-1], fit.covariance, f[:, :-1]) for f in regression.factors
    ]
    mean = np.array(variance) / np.maximum(regression.rows, 1)
    return BagDemand(judged.samples.name, np.array(beyond), np.sqrt(mean))


def extrapolation_warnings(
    fit: ModelFit, identification: Sequence[BagDemand], validation: Sequence[BagDemand]
) -> list[str]:
    """Return warnings about validation bags whose motion exceeds the identification motion."""
    names = fit.model.joint_names
    known = np.max([demand.uncertainty for demand in identification], axis=0)
    warnings = []
    for demand in validation:
        for (_, word), beyond in zip(_QUANTITIES, demand.beyond, strict=True):
            joints = [
                f'{name} by {100.0 * share:.0f} %'
                if share < _HARDLY_MOVED
                else f'{name}, which hardly moves in the identification motion'
                for name, share in zip(names, beyond, strict=True)
                if share > _TOLERATED
            ]
            if joints:
                warnings.append(
                    f'{demand.bag}: {word} leaves the range of the identification motion '
                    f'({", ".join(joints)}), so the model extrapolates in this bag'
                )
        grown = (demand.uncertainty > _GROWTH * known) & (demand.uncertainty > fit.noise.std)
        if grown.any():
            joints = [name for name, bad in zip(names, grown, strict=True) if bad]
            warnings.append(
                f'{demand.bag}: the torque of {", ".join(joints)} depends on parameters that the '
                'identification motion hardly excites; identify from a motion that is similar to '
                'this bag'
            )
    return warnings


_SMALLEST = 1e-300  # avoids division by zero for a bag without torque


@dataclass(frozen=True, eq=False)
class BagAssessment:
    """Torque errors of one solver's estimate on one bag.

    Attributes
    ----------
    filtered, filtered_measured, raw : float
        `100 |tau - tau_hat| / |tau|` over all joints stacked [%]. `filtered` compares measured
        and predicted torque, both low-pass filtered. `filtered_measured` compares filtered torque
        with the unfiltered prediction, as most publications do. `raw` compares recorded torque
        with the unfiltered prediction. Joints with constant recorded effort and samples with
        saturated effort are excluded.
    per_joint_filtered, per_joint_filtered_measured, per_joint_raw : (n,) ndarray
        Torque errors per joint [%]; NaN for an excluded joint.
    """

    bag: str
    filtered: float
    filtered_measured: float
    raw: float
    per_joint_filtered: Array
    per_joint_filtered_measured: Array
    per_joint_raw: Array
    prediction: Prediction

    def __repr__(self) -> str:
        """Return the torque errors of the bag as text."""
        return (
            f'<{self.bag}: torque error {self.filtered:.2f} % filtered, '
            f'{self.filtered_measured:.2f} % with only the measured torque filtered, '
            f'{self.raw:.2f} % raw>'
        )


def assess(estimate: Estimate, bags: Sequence[SampleColumns]) -> list[BagAssessment]:
    """Return the torque errors of an estimate on each of the bags."""
    results = []
    for bag in bags:
        prediction = bag.predict(estimate.model, estimate.theta)
        samples = bag.samples
        kept = samples.kept
        # 0 near saturation, which excludes these samples; NaN for a joint without measured samples.
        known = np.where(samples.measured.any(axis=0), samples.measured, np.nan)[kept]
        filtered, filtered_measured, raw = (
            torque_errors(known * measured[kept], known * predicted[kept])
            for measured, predicted in (
                (samples.tau, prediction.filtered),
                (samples.tau, prediction.raw),
                (samples.tau_raw, prediction.raw),
            )
        )
        total = (filtered[0], filtered_measured[0], raw[0])
        per_joint = (filtered[1], filtered_measured[1], raw[1])
        results.append(BagAssessment(samples.name, *total, *per_joint, prediction))
    return results


def torque_errors(measured: Array, predicted: Array) -> tuple[float, Array]:
    """Return the torque error, thesis (5.3), of all joints together and of each joint [%].

    Parameters
    ----------
    measured, predicted : (M, n) ndarray
        Torque [Nm]; NaN for joints without measurement, which the first error excludes.
    """
    difference = np.linalg.norm(measured - predicted, axis=0)
    size = np.linalg.norm(measured, axis=0)
    per_joint = 100.0 * difference / np.maximum(size, _SMALLEST)
    known = np.isfinite(size)
    whole = max(float(np.linalg.norm(size[known])), _SMALLEST)
    return 100.0 * float(np.linalg.norm(difference[known])) / whole, per_joint
