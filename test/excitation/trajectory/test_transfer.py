"""Ends and peaks of motions from rest to rest."""

import numpy as np
import pytest

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import standstill, transfer
from aerarm_ros.motion.polynomial_path import rest_to_rest_duration


def test_goes_from_rest_to_rest() -> None:
    start, end = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 4))
    way = transfer(start, end, 1.7)
    assert way.duration == 1.7
    for time, posture in ((0.0, start), (1.7, end)):
        for reached, wanted in zip(way.evaluate(time), (posture, 0.0, 0.0), strict=True):
            np.testing.assert_allclose(reached, wanted, atol=1e-12)


@pytest.mark.parametrize('travel', [0.05, 0.7, 3.0])
def test_the_peaks_reach_the_limits_exactly(travel: float) -> None:
    start, end = np.zeros(2), np.array([travel, -0.3 * travel])
    velocity, acceleration = np.array([1.0, 0.8]), np.array([2.0, 3.0])
    duration = rest_to_rest_duration(end - start, velocity, acceleration, minimum=0.01)
    reference = transfer(start, end, duration).evaluate(np.linspace(0.0, duration, 2001))
    used = max(
        (np.abs(reference.dq).max(axis=0) / velocity).max(),
        (np.abs(reference.ddq).max(axis=0) / acceleration).max(),
    )
    assert used == pytest.approx(1.0, abs=1e-3)


def test_standstill_stays() -> None:
    motion = standstill([0.1, -0.2])
    for reached, wanted in zip(motion.evaluate(0.5e-3), ([0.1, -0.2], 0.0, 0.0), strict=True):
        np.testing.assert_allclose(reached, wanted, atol=1e-12)


@pytest.mark.parametrize('duration', [0.0, -1.0, float('nan')])
def test_duration_must_be_positive(duration: float) -> None:
    with pytest.raises(ExcitationError, match='duration'):
        transfer(np.zeros(4), np.ones(4), duration)


@pytest.mark.parametrize('value', [float('nan'), float('inf')])
def test_postures_must_be_finite(value: float) -> None:
    with pytest.raises(ExcitationError, match='finite'):
        transfer(np.zeros(2), np.array([0.0, value]), 1.0)
