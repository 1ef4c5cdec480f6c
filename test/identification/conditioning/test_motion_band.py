"""The band of a motion, with and without measurement noise."""

from collections.abc import Sequence

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.conditioning import motion_band, position_band

DT = 1.0 / 125.0
T = DT * np.arange(5000)
OMEGA = 2 * np.pi * np.array([0.2, 0.8])
Q = np.sin(np.outer(T, OMEGA)) * [1.0, 0.1]
DQ = OMEGA * np.cos(np.outer(T, OMEGA)) * [1.0, 0.1]


@pytest.mark.parametrize('noise', [0.0, 0.02])
def test_the_fastest_joint_decides(noise: float) -> None:
    dq = DQ + noise * np.random.default_rng(0).standard_normal(DQ.shape)
    assert motion_band(Q, dq, DT) == pytest.approx(0.8, abs=0.1)
    assert motion_band(Q, None, DT) == pytest.approx(0.8, abs=0.1)


def test_a_joint_at_rest_does_not_matter() -> None:
    at_rest = np.zeros(len(T))
    moving = [np.column_stack([values[:, 0], at_rest]) for values in (Q, DQ)]
    assert motion_band(*moving, DT) == pytest.approx(0.2, abs=0.1)
    assert motion_band(np.zeros((100, 2)), None, DT) > 0.0


def test_noise_that_only_velocity_or_only_position_has_is_no_motion() -> None:
    """Noise of a filtered velocity is not white: only what positions do as well is motion."""
    noise = np.random.default_rng(1).standard_normal(len(T))
    low_passed = np.convolve(noise, np.ones(8) / 8, mode='same')
    noisy_dq, noisy_q = DQ.copy(), Q.copy()
    noisy_dq[:, 1] += 0.2 * low_passed
    noisy_q[:, 0] += 0.01 * low_passed
    assert motion_band(Q, noisy_dq, DT) == pytest.approx(0.8, abs=0.1)
    assert motion_band(noisy_q, DQ, DT) == pytest.approx(0.8, abs=0.1)
    # Where both are noisy, the positions themselves still show where the motion is.
    assert motion_band(noisy_q, noisy_dq, DT) > 0.7
    assert position_band(noisy_q, DT) < 1.0


def test_noise_in_both_that_falls_with_frequency_is_no_motion() -> None:
    """Independent noise of positions and filtered velocities has no coherence, motion has."""
    random = np.random.default_rng(2)
    steps = 0.05 * random.standard_normal(DQ.shape)
    noise = np.zeros_like(DQ)
    for k in range(1, len(T)):
        noise[k] = 0.9 * noise[k - 1] + steps[k]
    noisy_q = Q + 1e-3 * random.standard_normal(Q.shape)
    assert motion_band(noisy_q, DQ + noise, DT) == pytest.approx(0.8, abs=0.1)
    late = np.vstack([(DQ + noise)[:1]] * 3 + [(DQ + noise)[:-3]])
    assert motion_band(noisy_q, late, DT) == pytest.approx(0.8, abs=0.1)


def jolts(starts: Sequence[float]) -> np.ndarray:
    """Return the ringing velocity after the jolts of a trajectory's corners."""
    age = T[:, None] - np.array(starts)
    return np.where(age > 0.0, np.exp(-age / 0.1) * np.sin(2 * np.pi * 9.0 * age), 0.0).sum(axis=1)


def test_jolts_are_no_motion() -> None:
    ringing = np.outer(jolts([12.0, 16.1, 24.2]), [0.3, 0.3])
    q, dq = Q + np.cumsum(ringing, axis=0) * DT, DQ + ringing
    assert motion_band(q, dq, DT) == pytest.approx(0.8, abs=0.1)
    assert motion_band(q, None, DT) == pytest.approx(0.8, abs=0.1)


def test_vibration_of_one_joint_is_no_motion() -> None:
    omega = 2 * np.pi * 9.0
    q, dq = Q.copy(), DQ.copy()
    q[:, 1] += 0.02 / omega * np.sin(omega * T)
    dq[:, 1] += 0.02 * np.cos(omega * T)
    assert motion_band(q, dq, DT) == pytest.approx(0.8, abs=0.1)


def test_a_joint_that_moves_for_a_short_time_has_the_band_of_its_motion() -> None:
    moves = ((T > 15.0) & (T < 20.0)) * np.sin(np.pi * (T - 15.0) / 5.0) ** 2
    q = np.column_stack([Q[:, 0], moves * np.sin(2 * np.pi * 2.0 * T)])
    dq = np.gradient(q, DT, axis=0)
    assert motion_band(q, dq, DT) == pytest.approx(2.2, abs=0.3)


def test_a_resting_joint_does_not_hide_that_jolts_are_no_motion() -> None:
    """Only its noise is in the velocity, so its blocks contain no bursts."""
    random = np.random.default_rng(3)
    ringing = np.outer(jolts([12.0, 16.1, 24.2]), [0.3, 0.3])
    encoder = 1e-5 * random.standard_normal(len(T))
    q = np.column_stack([Q + np.cumsum(ringing, axis=0) * DT, encoder])
    dq = np.column_stack([DQ + ringing, 1e-3 * random.standard_normal(len(T))])
    assert motion_band(q, dq, DT) == pytest.approx(0.8, abs=0.1)
    assert motion_band(q, None, DT) == pytest.approx(0.8, abs=0.1)


def test_noisy_velocities_do_not_hide_that_jolts_are_no_motion() -> None:
    """White noise holds more than a thousandth of the power, in every block."""
    ringing = np.outer(jolts([12.0, 16.1, 24.2]), [1.0, 1.0])
    noise = 0.05 * np.random.default_rng(4).standard_normal(DQ.shape)
    q, dq = Q + np.cumsum(ringing, axis=0) * DT, DQ + ringing
    assert motion_band(q, dq + noise, DT) == pytest.approx(0.8, abs=0.1)


def test_vibration_of_measured_velocities_does_not_hide_fast_motion() -> None:
    """It is above the motion, and no noise that is also expected within the band of the motion."""
    omega = 2 * np.pi * np.array([5.0, 4.7])
    q = Q + 0.1 / omega * np.sin(np.outer(T, omega))
    dq = DQ + 0.1 * np.cos(np.outer(T, omega))
    vibration = 0.3 * np.cos(2 * np.pi * 40.0 * T)[:, None]
    assert motion_band(q, dq + vibration, DT) == pytest.approx(5.0, abs=0.1)
