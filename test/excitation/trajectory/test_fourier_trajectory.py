"""Derivatives, periodicity and band limit of (3.16)."""

import numpy as np
import pytest

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import FourierTrajectory

STEP = 1e-4


def test_velocity_and_acceleration_are_the_derivatives(trajectory: FourierTrajectory) -> None:
    time = np.linspace(0.0, trajectory.period, 301)
    before, at, after = (trajectory.evaluate(time + d) for d in (-STEP, 0.0, STEP))
    velocity = (after.q - before.q) / (2.0 * STEP)
    acceleration = (after.dq - before.dq) / (2.0 * STEP)
    np.testing.assert_allclose(at.dq, velocity, atol=1e-6)
    np.testing.assert_allclose(at.ddq, acceleration, atol=1e-6)


def test_sine_and_cosine_enter_as_in_3_16() -> None:
    trajectory = FourierTrajectory(
        0.1, np.array([1.0]), np.array([[0.0, 0.3]]), np.array([[0.2, 0.0]])
    )
    time, w0 = 1.7, 0.2 * np.pi
    expected = 1.0 + 0.3 * np.sin(2 * w0 * time) + 0.2 * np.cos(w0 * time)
    assert trajectory.evaluate(time).q == pytest.approx([expected])
    assert trajectory.evaluate(0.0).dq == pytest.approx([0.3 * 2 * w0])


def test_repeats_after_a_period_and_holds_only_the_n_harmonics(
    trajectory: FourierTrajectory,
) -> None:
    time = np.arange(0.0, trajectory.period, 0.01)
    position = trajectory.evaluate(time).q
    a_period_later = trajectory.evaluate(time + trajectory.period).q
    np.testing.assert_allclose(a_period_later, position, atol=1e-12)
    spectrum = np.abs(np.fft.rfft(position, axis=0)) / len(time)
    assert spectrum[trajectory.harmonics + 1 :].max() < 1e-12
    np.testing.assert_allclose(spectrum[0], np.abs(trajectory.q0), atol=1e-12)
    assert trajectory.highest_frequency == pytest.approx(0.5)


def test_scalar_time_gives_one_row(trajectory: FourierTrajectory) -> None:
    many = trajectory.evaluate(np.array([0.4, 0.9])).q
    assert many.shape == (2, trajectory.n)
    np.testing.assert_allclose(trajectory.evaluate(0.9).q, many[1], rtol=0.0, atol=1e-15)


@pytest.mark.parametrize(
    ('f0', 'q0', 'alpha', 'beta', 'message'),
    [
        (0.0, [0.0], [[0.1]], [[0.1]], 'fundamental'),
        (float('nan'), [0.0], [[0.1]], [[0.1]], 'fundamental'),
        (0.1, [0.0, 0.0], [[0.1]], [[0.1]], '2 joints'),
        (0.1, [0.0], [[0.1]], [[0.1, 0.2]], 'the same shape'),
        (0.1, [0.0], [[]], [[]], 'at least one harmonic'),
        (0.1, [0.0], [[np.nan]], [[0.1]], 'finite'),
    ],
)
def test_wrong_coefficients_are_refused(f0, q0, alpha, beta, message) -> None:
    with pytest.raises(ExcitationError, match=message):
        FourierTrajectory(f0, np.array(q0), np.array(alpha), np.array(beta))
