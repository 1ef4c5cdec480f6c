"""The trust in a prediction follows the fraction of the IMU's motion that it explains."""

import numpy as np
import pytest

from aerarm_ros.control.base.free_base_estimator import AnswerCorrection

PERIOD = 0.004
FORCE_NOISE, RATE_NOISE = 0.3, 0.01  # of a cheap IMU [m/s^2], [rad/s]


def trust(predicted: float, measured: float, noise: float, frequency: float = 0.35) -> np.ndarray:
    """Return the trust after 20 s of swings of given sizes [m/s^2], [rad/s^2], with a noisy IMU."""
    random = np.random.default_rng(0)
    correction, last = AnswerCorrection(), np.zeros(3)
    for now in np.arange(0.0, 20.0, PERIOD):
        swing = np.full(6, np.sin(2.0 * np.pi * frequency * now))
        force, rate = noise * random.standard_normal((2, 3))
        # Angular acceleration is the difference of two rates.
        shake = np.concatenate([FORCE_NOISE * force, RATE_NOISE * (rate - last) / PERIOD])
        last = rate
        correction.update(predicted * swing, measured * swing + shake, PERIOD)
    return correction.trust


@pytest.mark.parametrize('noise', [0.0, 1.0])
def test_a_small_prediction_that_explains_nothing_loses_its_weight(noise: float) -> None:
    """Too small a mass in the drone file, a heavy drone, slow motion: the arm's model is wrong."""
    assert trust(0.24, 0.02, noise).max() < 0.35


@pytest.mark.parametrize(('predicted', 'expected'), [(0.0, 1.0), (0.24, 1.0), (0.2, 1.2)])
def test_a_correct_or_uninformative_prediction_keeps_its_weight(
    predicted: float, expected: float
) -> None:
    measured = 0.24 if predicted else 0.0
    np.testing.assert_allclose(trust(predicted, measured, 0.0), expected, atol=0.06)


def test_noise_is_not_taken_for_a_wrong_prediction() -> None:
    np.testing.assert_allclose(trust(2.0, 2.0, 1.0), 1.0, atol=0.1)
