"""The torque error (5.3)."""

import numpy as np
import pytest

from aerarm_ros.identification.assessment import torque_errors
from aerarm_ros.identification.identification_result import IdentificationResult


def test_joints_are_stacked() -> None:
    measured = np.array([[3.0, 4.0], [0.0, 0.0]])
    predicted = np.array([[3.0, 3.0], [0.0, 0.0]])
    total, per_joint = torque_errors(measured, predicted)
    assert total == pytest.approx(20.0)
    assert per_joint == pytest.approx([0.0, 25.0])


def test_silence_gives_no_division_by_zero() -> None:
    total, per_joint = torque_errors(np.zeros((5, 2)), np.zeros((5, 2)))
    assert total == 0.0
    assert not per_joint.any()


def test_a_joint_of_which_nothing_was_measured_does_not_count() -> None:
    measured = np.array([[3.0, np.nan], [4.0, np.nan]])
    total, per_joint = torque_errors(measured, np.array([[3.0, 9.0], [3.0, 9.0]]))
    assert total == pytest.approx(20.0)
    assert np.array_equal(np.isnan(per_joint), [False, True])


def test_assessments_are_those_of_the_predictions(result: IdentificationResult) -> None:
    for solution in result.solutions.values():
        (assessment,) = solution.validation
        (bag,) = result.validation
        kept = bag.samples.kept
        expected, _ = torque_errors(bag.samples.tau[kept], assessment.prediction.filtered[kept])
        assert assessment.filtered == expected
        assert assessment.raw > assessment.filtered  # the noise cannot be predicted
        quoted, _ = torque_errors(bag.samples.tau[kept], assessment.prediction.raw[kept])
        assert assessment.filtered_measured == quoted
