"""Windows, cut-offs, filters and delays chosen from data, and options that contradict them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.conditioning import (
    Conditioner,
    motion_band,
    velocity_lag,
)
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.conditioning.uniform_motion import KinematicsFilter, aperiodic_motion
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording

FREE = ConditioningOptions()


@pytest.fixture(scope='module')
def recording(make_arm: Callable):
    return make_arm(rate=500.0).recording(1, noise=1.0)


@pytest.mark.parametrize('from_position', [False, True])
@pytest.mark.parametrize('harmonics', [5, 50, None])
def test_kinematics_come_out_as_they_went_in(
    make_arm: Callable, recording, harmonics: int | None, from_position: bool
) -> None:
    """Noise on top of a known motion is removed; acceleration is its derivative."""
    conditioner = Conditioner([recording], FREE)
    assert (conditioner.fundamental, conditioner.cutoff) == pytest.approx((0.1, 5.0))
    assert {f.harmonics for f in conditioner.candidates()} == {5, 50, None}
    samples = conditioner.condition(recording, KinematicsFilter(5.0, harmonics, from_position))
    t, *motion = make_arm(rate=500.0).motion(1)
    found = samples.q, samples.dq, samples.ddq
    for values, true, tolerance in zip(found, motion, (1e-4, 2e-3, 4e-2), strict=True):
        exact = np.column_stack([np.interp(samples.time, t, column) for column in true.T])
        assert np.sqrt(np.mean((values - exact)[5:-5] ** 2)) < tolerance


def test_rows_of_resting_joints_and_dead_sensors_are_not_fitted(recording) -> None:
    resting = recording.q.copy()
    resting[(recording.time > 8.0) & (recording.time < 12.0), 2] = 0.4
    dead = np.array([False, False, False, True])
    changed = replace(recording, q=resting, dq=None, dead_effort=dead)
    conditioner = Conditioner([changed], ConditioningOptions(fundamental=0.1))
    samples = conditioner.condition(changed, KinematicsFilter(5.0, None, True))
    rest = (samples.time > 8.5) & (samples.time < 11.5)
    assert not samples.usable[rest, 2].any()
    assert samples.usable[rest, 0].all()
    assert not samples.usable[:, 3].any()


def test_cutoffs_to_try_reach_from_the_rule_down_to_the_positions(recording) -> None:
    assert Conditioner([recording], FREE).cutoffs == pytest.approx((2.5, 3.5, 5.0))
    noisy = 0.05 * np.random.default_rng(0).standard_normal(recording.q.shape)
    smooth = np.apply_along_axis(lambda x: np.convolve(x, np.ones(10) / 10, 'same'), 0, noisy)
    part = recording.part(0.1, 0.6, '')
    blurred = replace(part, q=part.q + 0.03 * smooth[: len(part.q)], dq=None)
    misled = Conditioner([blurred], FREE)
    assert misled.cutoffs[0] < 5.0 < 20.0 < misled.cutoff
    assert Conditioner([blurred], ConditioningOptions(cutoff=6.0)).cutoffs == (6.0,)


def test_a_short_fast_motion_of_all_joints_stays_below_the_cutoff() -> None:
    """It counts as a burst of the velocity, but positions show that it is part of the motion."""
    t = np.arange(0.0, 30.0, 4e-3)
    omega, inside = 2.0 * np.pi, (t > 13.2) & (t < 16.8)
    fast = 0.12 * inside * np.sin(np.pi * (t - 13.2) / 3.6) ** 2
    q = np.column_stack([np.sin(omega * 0.1 * t), 0.8 * np.cos(omega * 0.1 * t)])
    q += fast[:, None] * np.sin(omega * np.outer(t, [2.0, 1.7])) + 0.02 * t[:, None]
    dq, tau, valid = np.gradient(q, t, axis=0), np.zeros_like(q), np.zeros(2, dtype=bool)
    conditioner = Conditioner([Recording('motion', ('a', 'b'), t, q, dq, tau, valid)], FREE)
    assert conditioner.fundamental is None
    assert min(*conditioner.cutoffs, conditioner.cutoff) > 4.0


@pytest.fixture(scope='module')
def brief(make_arm: Callable):
    return make_arm(rate=100.0).recording(1)


@pytest.mark.parametrize(
    ('last', 'options', 'words'),
    [
        (1.0, {}, ''),
        (1.0, {'fundamental': 0.1}, ''),
        (1.0, {'fundamental': 0.05}, ''),  # two periods together are periodic too
        (1.0, {'fundamental': 0.13}, 'repeats every 10 s'),
        (0.6, {'fundamental': 0.01}, 'contains less than one period of 100 s'),
    ],
)
def test_options_that_contradict_the_motion_cause_warnings(
    brief: Recording, last: float, options: dict, words: str
) -> None:
    part = brief if last == 1.0 else brief.part(0.0, last, '')
    text = ' '.join(Conditioner([part], ConditioningOptions(**options)).warnings)
    assert words in text
    assert bool(words) == bool(text)


@pytest.mark.parametrize(
    ('last', 'options', 'words'),
    [
        (1.0, {'cutoff': 1e-9}, 'would filter out the motion'),
        (1.0, {'cutoff': 48.0}, 'above 40 Hz.*choose a lower cutoff'),
        (1.0, {'fundamental': 7.0}, 'repeats every 10 s'),
        (0.6, {'fundamental': 7.0}, '7 Hz, but .* does not repeat .* 0.142'),
        (1.0, {'cutoff': -1.0}, 'cutoff = -1.0 must be a positive frequency'),
        (1.0, {'fundamental': float('nan')}, 'fundamental'),
    ],
)
def test_impossible_options_are_refused(
    brief: Recording, last: float, options: dict, words: str
) -> None:
    with pytest.raises(IdentificationError, match=words):
        Conditioner([brief.part(0.0, last, '')], ConditioningOptions(**options))


DT = 1.0 / 125.0
T = DT * np.arange(5000)
OMEGA = 2 * np.pi * np.array([0.2, 0.8])
Q = np.sin(np.outer(T, OMEGA)) * [1.0, 0.1]
DQ = OMEGA * np.cos(np.outer(T, OMEGA)) * [1.0, 0.1]
Motion = tuple[np.ndarray, np.ndarray | None]


def noisy(size: float) -> Motion:
    return Q, DQ + size * np.random.default_rng(0).standard_normal(DQ.shape)


def falling_noise(late: int) -> Motion:
    """Independent noise of positions and filtered velocities has no coherence, motion has."""
    random = np.random.default_rng(2)
    steps, noise = 0.05 * random.standard_normal(DQ.shape), np.zeros_like(DQ)
    for k in range(1, len(T)):
        noise[k] = 0.9 * noise[k - 1] + steps[k]
    dq = DQ + noise
    q = Q + 1e-3 * random.standard_normal(Q.shape)
    return q, np.vstack([dq[:1]] * late + [dq[: len(dq) - late]])


def jolts() -> Motion:
    """Add the ringing velocity after the jolts of a trajectory's corners."""
    age = T[:, None] - np.array([12.0, 16.1, 24.2])
    waves = np.where(age > 0.0, np.exp(-age / 0.1) * np.sin(2 * np.pi * 9.0 * age), 0.0)
    ringing = np.outer(waves.sum(axis=1), [0.3, 0.3])
    return Q + np.cumsum(ringing, axis=0) * DT, DQ + ringing


def vibration_of_one_joint() -> Motion:
    omega = 2 * np.pi * 9.0
    only = np.array([0.0, 0.02])
    return Q + np.outer(np.sin(omega * T), only) / omega, DQ + np.outer(np.cos(omega * T), only)


def short_motion() -> Motion:
    moves = ((T > 15.0) & (T < 20.0)) * np.sin(np.pi * (T - 15.0) / 5.0) ** 2
    q = np.column_stack([Q[:, 0], moves * np.sin(2 * np.pi * 2.0 * T)])
    return q, np.gradient(q, DT, axis=0)


def vibration_above_fast_motion() -> Motion:
    """It is above the motion, and no noise that is also expected within the band of the motion."""
    omega = 2 * np.pi * np.array([5.0, 4.7])
    q = Q + 0.1 / omega * np.sin(np.outer(T, omega))
    vibration = 0.3 * np.cos(2 * np.pi * 40.0 * T)[:, None]
    return q, DQ + 0.1 * np.cos(np.outer(T, omega)) + vibration


@pytest.mark.parametrize(
    ('motion', 'band', 'tolerance'),
    [
        (noisy(0.0), 0.8, 0.1),
        (noisy(0.02), 0.8, 0.1),
        ((Q, None), 0.8, 0.1),
        (falling_noise(0), 0.8, 0.1),
        (falling_noise(3), 0.8, 0.1),
        (jolts(), 0.8, 0.1),
        ((jolts()[0], None), 0.8, 0.1),
        (vibration_of_one_joint(), 0.8, 0.1),
        (short_motion(), 2.2, 0.3),
        (vibration_above_fast_motion(), 5.0, 0.1),
    ],
)
def test_the_fastest_joint_determines_the_band(
    motion: Motion, band: float, tolerance: float
) -> None:
    assert motion_band(*motion, DT) == pytest.approx(band, abs=tolerance)
    assert motion_band(np.zeros((100, 2)), None, DT) > 0.0  # at rest


def test_the_lag_is_estimated_and_ignored_below_two_milliseconds(arm) -> None:
    motions = []
    for noise in (0.0, 1.0):
        bag = arm.recording(1, noise=noise)
        late = [
            np.interp(bag.time - delay, bag.time, column)
            for delay, column in zip((0.0, 5e-3, -4e-3, 1e-3), bag.dq.T, strict=True)
        ]
        motions.append(aperiodic_motion(replace(bag, dq=np.column_stack(late))))
    for bags in (motions[:1], motions[1:], motions):
        assert velocity_lag(bags, 5.0) == pytest.approx([0.0, 5e-3, -4e-3, 0.0], abs=2e-4)
    assert not velocity_lag([replace(motions[0], dq=None)], 5.0).any()
