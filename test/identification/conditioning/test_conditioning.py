"""Windows, cut-offs and filters chosen from data."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.conditioning.uniform_motion import BLOCKS, KinematicsFilter
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording

FREE = ConditioningOptions()


@pytest.fixture(scope='module')
def recording(make_arm: Callable):
    return make_arm(rate=500.0).recording(1, noise=1.0)


def test_a_periodic_motion_is_recognised(recording) -> None:
    conditioner = Conditioner([recording], FREE)
    assert conditioner.fundamental == pytest.approx(0.1)
    assert conditioner.harmonics == 5
    assert conditioner.cutoff == pytest.approx(5.0)
    rectangular = {f.harmonics for f in conditioner.candidates()}
    assert rectangular == {5, 50, None}


def test_given_settings_are_not_searched(recording) -> None:
    known = ConditioningOptions(fundamental=0.2, harmonics=3, cutoff=7.0)
    conditioner = Conditioner([recording], known)
    assert (conditioner.fundamental, conditioner.harmonics) == (pytest.approx(0.2), 3)
    assert conditioner.cutoff == 7.0


def test_a_part_of_a_period_is_not_periodic(recording) -> None:
    conditioner = Conditioner([recording.part(0.0, 0.6, '')], FREE)
    assert conditioner.fundamental is None
    assert all(f.harmonics is None for f in conditioner.candidates())
    assert 3.0 < conditioner.cutoff < 15.0


@pytest.mark.parametrize('from_position', [False, True])
@pytest.mark.parametrize('harmonics', [5, 50, None])
def test_kinematics_come_out_as_they_went_in(
    make_arm: Callable, recording, harmonics: int | None, from_position: bool
) -> None:
    """Noise on top of a known motion is removed; acceleration is its derivative."""
    conditioner = Conditioner([recording], FREE)
    samples = conditioner.condition(recording, KinematicsFilter(5.0, harmonics, from_position))
    t, q, dq, ddq = make_arm(rate=500.0).motion(1)
    inside = slice(5, -5)
    for found, true, tolerance in (
        (samples.q, q, 1e-4),
        (samples.dq, dq, 2e-3),
        (samples.ddq, ddq, 4e-2),
    ):
        exact = np.column_stack([np.interp(samples.time, t, column) for column in true.T])
        assert np.sqrt(np.mean((found - exact)[inside] ** 2)) < tolerance


def test_samples_cover_two_periods_at_five_times_the_cutoff(recording) -> None:
    conditioner = Conditioner([recording], FREE)
    samples = conditioner.condition(recording, conditioner.candidates()[0])
    assert samples.recorded == 10_000
    assert samples.step == 20
    assert len(samples.time) == 500
    assert samples.kept.all()
    # Both passes of the same part of the period are left out together.
    assert np.array_equal(samples.fold[:250], samples.fold[250:])
    assert np.array_equal(np.unique(samples.fold), np.arange(5))


def test_fast_recordings_are_decimated_before_they_are_filtered(make_arm: Callable) -> None:
    """A kilohertz is more than a filter at 5 Hz can use; the kinematics stay the same."""
    fast = make_arm(rate=1000.0).recording(1, noise=1.0)
    conditioner = Conditioner([fast], FREE)
    kinematics = KinematicsFilter(5.0, None, False)
    samples = conditioner.condition(fast, kinematics)
    assert samples.recorded == 20_000
    assert len(samples.dq_fine) == 10_000
    assert samples.step == 20
    t, _, _, ddq = make_arm(rate=1000.0).motion(1)
    exact = np.column_stack([np.interp(samples.time, t, column) for column in ddq.T])
    assert np.sqrt(np.mean((samples.ddq - exact)[5:-5] ** 2)) < 4e-2
    # Torque as recorded stays as recorded.
    rows = np.searchsorted(fast.time, samples.time - 1e-6)
    assert np.allclose(samples.tau_raw, fast.tau[rows], atol=1e-3)


def test_ends_of_an_aperiodic_motion_are_left_out(recording) -> None:
    part = recording.part(0.2, 0.7, '')
    conditioner = Conditioner([part], FREE)
    samples = conditioner.condition(part, conditioner.candidates()[0])
    edge = np.flatnonzero(samples.kept)[0]
    assert edge * samples.step / 500.0 == pytest.approx(0.5 / conditioner.cutoff, abs=0.05)
    assert np.all(np.diff(samples.block) >= 0)
    assert set(samples.block) == set(range(BLOCKS))


def test_rows_of_resting_joints_and_dead_sensors_are_not_fitted(recording) -> None:
    resting = recording.q.copy()
    middle = (recording.time > 8.0) & (recording.time < 12.0)
    resting[middle, 2] = 0.4
    dead = np.array([False, False, False, True])
    changed = replace(recording, q=resting, dq=None, dead_effort=dead)
    conditioner = Conditioner([changed], ConditioningOptions(fundamental=0.1))
    samples = conditioner.condition(changed, KinematicsFilter(5.0, None, True))
    rest = (samples.time > 8.5) & (samples.time < 11.5)
    assert not samples.usable[rest, 2].any()
    assert samples.usable[rest, 0].all()
    assert not samples.usable[:, 3].any()


def test_cutoffs_to_try_reach_from_the_rule_down_to_the_positions(recording) -> None:
    conditioner = Conditioner([recording], FREE)
    assert conditioner.cutoffs == pytest.approx((2.5, 3.5, 5.0))
    noisy = 0.05 * np.random.default_rng(0).standard_normal(recording.q.shape)
    smooth = np.apply_along_axis(lambda x: np.convolve(x, np.ones(10) / 10, 'same'), 0, noisy)
    part = recording.part(0.1, 0.6, '')
    blurred = replace(part, q=part.q + 0.03 * smooth[: len(part.q)], dq=None)
    misled = Conditioner([blurred], FREE)
    assert misled.cutoff > 20.0
    assert misled.cutoffs[0] < 5.0
    fixed = Conditioner([blurred], ConditioningOptions(cutoff=6.0))
    assert fixed.cutoffs == (6.0,)


def test_trials_have_their_samples_in_common(recording) -> None:
    conditioner = Conditioner([recording], FREE)
    found = [c.trial(recording, c.candidates()[-1]) for c in (conditioner, conditioner.at(2.5))]
    assert np.array_equal(found[0].time, found[1].time)
    assert np.array_equal(found[0].tau_raw, found[1].tau_raw)
    assert not np.allclose(found[0].tau, found[1].tau, atol=1e-3)


def test_a_cutoff_below_the_motion_is_refused(recording) -> None:
    with pytest.raises(IdentificationError, match='would filter out the motion'):
        Conditioner([recording], ConditioningOptions(cutoff=1e-9))


def test_a_cutoff_above_the_rate_is_refused(recording) -> None:
    with pytest.raises(IdentificationError, match='above 200 Hz.*choose a lower cutoff'):
        Conditioner([recording], ConditioningOptions(cutoff=240.0))


def test_a_short_fast_motion_of_all_joints_stays_below_the_cutoff() -> None:
    """It counts as a burst of the velocity, but positions show that it is part of the motion."""
    t = np.arange(0.0, 30.0, 4e-3)
    omega, inside = 2.0 * np.pi, (t > 13.2) & (t < 16.8)
    fast = 0.12 * inside * np.sin(np.pi * (t - 13.2) / 3.6) ** 2
    q = np.column_stack([np.sin(omega * 0.1 * t), 0.8 * np.cos(omega * 0.1 * t)])
    q += fast[:, None] * np.sin(omega * np.outer(t, [2.0, 1.7])) + 0.02 * t[:, None]
    dq, tau, valid = np.gradient(q, t, axis=0), np.zeros_like(q), np.zeros(2, dtype=bool)
    recording = Recording('motion', ('a', 'b'), t, q, dq, tau, valid)
    conditioner = Conditioner([recording], FREE)
    assert conditioner.fundamental is None
    assert conditioner.cutoff > 4.0
    assert min(conditioner.cutoffs) > 4.0
