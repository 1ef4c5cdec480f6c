"""Torque error of an estimate, thesis (5.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.regression.sample_columns import Prediction, SampleColumns
from aerarm_ros.identification.solvers.estimate import Estimate

Array = npt.NDArray[np.float64]

_SMALLEST = 1e-300  # keeps a bag without torque from dividing by zero


@dataclass(frozen=True, eq=False)
class BagAssessment:
    """How well an estimate predicts the torque of one bag.

    Attributes
    ----------
    bag : str
    filtered, filtered_measured, raw : float
        `100 |tau - tau_hat| / |tau|` over all joints stacked [%]: for torque and prediction
        through the same low-pass; for filtered torque and the prediction as it is, which is what
        most publications quote; and for measured torque as recorded. A joint whose recorded
        effort never changes does not count: nothing was measured of it. Nor does saturated effort.
    per_joint_filtered, per_joint_filtered_measured, per_joint_raw : (n,) ndarray
        The same for each joint alone [%]; NaN for one that does not count.
    prediction : Prediction
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
        """Return the errors without the samples."""
        return (
            f'<{self.bag}: torque error {self.filtered:.2f} % filtered, '
            f'{self.filtered_measured:.2f} % only the measured one, {self.raw:.2f} % raw>'
        )


def assess(estimate: Estimate, bags: Sequence[SampleColumns]) -> list[BagAssessment]:
    """Return the torque errors of an estimate on each bag."""
    results = []
    for bag in bags:
        prediction = bag.predict(estimate.model, estimate.theta)
        samples = bag.samples
        kept = samples.kept
        # 0 near saturation, which leaves these samples out; NaN for a joint without any.
        known = np.where(samples.measured.any(axis=0), samples.measured, np.nan)[kept]
        filtered, filtered_measured, raw = (
            torque_errors(known * measured[kept], known * predicted[kept])
            for measured, predicted in (
                (samples.tau, prediction.filtered),
                (samples.tau, prediction.raw),
                (samples.tau_raw, prediction.raw),
            )
        )
        results.append(
            BagAssessment(
                bag=samples.name,
                filtered=filtered[0],
                filtered_measured=filtered_measured[0],
                raw=raw[0],
                per_joint_filtered=filtered[1],
                per_joint_filtered_measured=filtered_measured[1],
                per_joint_raw=raw[1],
                prediction=prediction,
            )
        )
    return results


def torque_errors(measured: Array, predicted: Array) -> tuple[float, Array]:
    """Return (5.3) of all joints stacked, and of each joint, both in percent.

    Parameters
    ----------
    measured, predicted : (M, n) ndarray
        [Nm]; a joint of which nothing was measured is NaN, and left out of the first.
    """
    difference = np.linalg.norm(measured - predicted, axis=0)
    size = np.linalg.norm(measured, axis=0)
    per_joint = 100.0 * difference / np.maximum(size, _SMALLEST)
    known = np.isfinite(size)
    whole = max(float(np.linalg.norm(size[known])), _SMALLEST)
    return 100.0 * float(np.linalg.norm(difference[known])) / whole, per_joint
