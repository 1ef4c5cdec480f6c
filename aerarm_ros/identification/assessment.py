"""Torque error of an estimate, thesis (5.3)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.estimate import Estimate
from aerarm_ros.identification.sample_columns import Prediction, SampleColumns

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BagAssessment:
    """How well an estimate predicts the torque of one bag.

    Attributes
    ----------
    bag : str
    filtered, raw : float
        `100 |tau - tau_hat| / |tau|` over all joints stacked [%]: for torque and prediction
        through the same low-pass, and for measured torque as recorded.
    per_joint_filtered, per_joint_raw : (n,) ndarray
        The same for each joint alone [%].
    prediction : Prediction
    """

    bag: str
    filtered: float
    raw: float
    per_joint_filtered: Array
    per_joint_raw: Array
    prediction: Prediction


def assess(estimate: Estimate, bags: Sequence[SampleColumns]) -> list[BagAssessment]:
    """Return the torque errors of an estimate on each bag."""
    results = []
    for bag in bags:
        prediction = bag.predict(estimate.model, estimate.theta)
        samples = bag.samples
        kept = samples.kept
        filtered = torque_errors(samples.tau[kept], prediction.filtered[kept])
        raw = torque_errors(samples.tau_raw[kept], prediction.raw[kept])
        results.append(
            BagAssessment(samples.name, filtered[0], raw[0], filtered[1], raw[1], prediction)
        )
    return results


def torque_errors(measured: Array, predicted: Array) -> tuple[float, Array]:
    """Return (5.3) of all joints stacked, and of each joint, both in percent.

    Parameters
    ----------
    measured, predicted : (M, n) ndarray
        [Nm]
    """
    difference, size = (
        np.linalg.norm(measured - predicted, axis=0),
        np.linalg.norm(measured, axis=0),
    )
    per_joint = 100.0 * difference / np.maximum(size, 1e-300)
    return 100.0 * float(np.linalg.norm(difference)) / max(
        float(np.linalg.norm(size)), 1e-300
    ), per_joint
