"""Boundary states and peaks of point-to-point motions."""

import numpy as np
import pytest

from aerarm_ros.excitation.excitation_error import ExcitationError
from aerarm_ros.excitation.joint_reference import JointReference
from aerarm_ros.excitation.quintic_segment import (
    QuinticSegment,
    at_rest,
    rest_to_rest_duration,
)


def random_state(seed: int) -> JointReference:
    return JointReference(*np.random.default_rng(seed).uniform(-1.0, 1.0, (3, 4)))


def test_meets_both_boundary_states() -> None:
    start, end = random_state(1), random_state(2)
    segment = QuinticSegment(start, end, 1.7)
    for time, state in ((0.0, start), (1.7, end)):
        for reached, wanted in zip(segment.evaluate(time), state, strict=True):
            np.testing.assert_allclose(reached, wanted, atol=1e-12)


def test_derivatives_are_consistent() -> None:
    segment = QuinticSegment(random_state(3), random_state(4), 2.0)
    time = np.linspace(0.0, 2.0, 4001)
    reference = segment.evaluate(time)
    numeric = np.gradient(reference.position, time, axis=0)
    np.testing.assert_allclose(numeric[1:-1], reference.velocity[1:-1], atol=1e-5)
    numeric = np.gradient(reference.velocity, time, axis=0)
    np.testing.assert_allclose(numeric[1:-1], reference.acceleration[1:-1], atol=1e-5)


@pytest.mark.parametrize('travel', [0.05, 0.7, 3.0])
def test_rest_to_rest_reaches_the_allowed_peaks_and_no_more(travel: float) -> None:
    start, end = np.zeros(2), np.array([travel, -0.3 * travel])
    velocity, acceleration = np.array([1.0, 0.8]), np.array([2.0, 3.0])
    duration = rest_to_rest_duration(end - start, velocity, acceleration, minimum=0.01)
    segment = QuinticSegment(at_rest(start), at_rest(end), duration)
    reference = segment.evaluate(np.linspace(0.0, duration, 2001))
    used = max(
        (np.abs(reference.velocity).max(axis=0) / velocity).max(),
        (np.abs(reference.acceleration).max(axis=0) / acceleration).max(),
    )
    assert used == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize('duration', [0.0, -1.0, float('nan')])
def test_duration_must_be_positive(duration: float) -> None:
    with pytest.raises(ExcitationError, match='duration'):
        QuinticSegment(random_state(1), random_state(2), duration)
