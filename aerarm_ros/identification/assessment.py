"""Torque error of an estimate, thesis (5.3), and warnings about extrapolation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerarm_ros.identification.regression.model_fit import ModelFit, RegressionBank
from aerarm_ros.identification.regression.regression import Prediction, SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.motion.signals import Array

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
