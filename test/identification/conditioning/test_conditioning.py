"""Windows, cut-offs, filters and delays chosen from data, and options that contradict them."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.conditioning import (
    Conditioner,
    motion_band,
    velocity_lag,
)
from aerarm_ros.identification.conditioning.motion_check import (
    ConditioningOptions,
    harmonics_warnings,
)
from aerarm_ros.identification.conditioning.uniform_motion import KinematicsFilter, aperiodic_motion
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


@pytest.mark.parametrize(
    ('options', 'text'),
    [
        ({'cutoff': -1.0}, 'cutoff = -1.0 must be a positive frequency'),
        ({'fundamental': float('nan')}, 'fundamental'),
        ({'harmonics': 0}, 'at least 1'),
        ({'filter': 'none'}, "filter 'none': choose auto, harmonics, butterworth"),
    ],
)
def test_nonsense_is_refused(options: dict, text: str) -> None:
    with pytest.raises(IdentificationError, match=text):
        ConditioningOptions(**options)


@pytest.fixture(scope='module')
def brief(make_arm: Callable):
    return make_arm(rate=100.0).recording(1)


def warnings(recording, **options: object) -> str:
    return ' '.join(Conditioner([recording], ConditioningOptions(**options)).warnings)


def test_options_that_match_the_motion_cause_no_warning(brief) -> None:
    assert warnings(brief) == ''
    assert warnings(brief, fundamental=0.1, harmonics=5) == ''
    # Two periods together are periodic too.
    assert warnings(brief, fundamental=0.05) == ''


def test_a_wrong_fundamental_is_named_where_nothing_is_left_or_it_is_needed(brief) -> None:
    for options in ({'fundamental': 7.0}, {'fundamental': 0.13, 'filter': 'harmonics'}):
        with pytest.raises(IdentificationError, match='repeats every 10 s'):
            warnings(brief, **options)
    once = brief.part(0.0, 0.6, '')
    with pytest.raises(
        IdentificationError, match=r'7 Hz, but the motion of .* does not repeat .* 0.142'
    ):
        warnings(once, fundamental=7.0, filter='harmonics')


def test_fewer_harmonics_than_the_motion_has(brief) -> None:
    assert '5 harmonics, up to 0.5 Hz' in warnings(brief, harmonics=3)
    assert harmonics_warnings(7, 5, 0.1, 100.0) == []


def test_harmonics_need_whole_periods(brief) -> None:
    part = brief.part(0.0, 0.6, '')
    assert 'so --harmonics is ignored' in warnings(part, harmonics=5)
    with pytest.raises(IdentificationError, match='no whole period of --fundamental 0.01 Hz'):
        warnings(part, filter='harmonics', fundamental=0.01)
    with pytest.raises(IdentificationError, match='--filter harmonics needs whole periods'):
        warnings(part, filter='harmonics')


def test_harmonics_stay_below_the_nyquist_frequency(brief) -> None:
    with pytest.raises(IdentificationError, match='60 Hz, beyond the Nyquist frequency 50 Hz'):
        warnings(brief, harmonics=600)


DT = 1.0 / 125.0
T = DT * np.arange(5000)
OMEGA = 2 * np.pi * np.array([0.2, 0.8])
Q = np.sin(np.outer(T, OMEGA)) * [1.0, 0.1]
DQ = OMEGA * np.cos(np.outer(T, OMEGA)) * [1.0, 0.1]


@pytest.mark.parametrize('noise', [0.0, 0.02])
def test_the_fastest_joint_decides(noise: float) -> None:
    assert motion_band(np.zeros((100, 2)), None, DT) > 0.0  # at rest
    dq = DQ + noise * np.random.default_rng(0).standard_normal(DQ.shape)
    assert motion_band(Q, dq, DT) == pytest.approx(0.8, abs=0.1)
    assert motion_band(Q, None, DT) == pytest.approx(0.8, abs=0.1)


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


def test_vibration_of_measured_velocities_does_not_hide_fast_motion() -> None:
    """It is above the motion, and no noise that is also expected within the band of the motion."""
    omega = 2 * np.pi * np.array([5.0, 4.7])
    q = Q + 0.1 / omega * np.sin(np.outer(T, omega))
    dq = DQ + 0.1 * np.cos(np.outer(T, omega))
    vibration = 0.3 * np.cos(2 * np.pi * 40.0 * T)[:, None]
    assert motion_band(q, dq + vibration, DT) == pytest.approx(5.0, abs=0.1)


CUTOFF = 5.0
LATE = np.array([0.0, 5e-3, -4e-3, 1e-3])


def late_recording(arm, noise: float, measured: bool = True) -> Recording:
    bag = arm.recording(1, noise=noise)
    late = [np.interp(bag.time - d, bag.time, v) for d, v in zip(LATE, bag.dq.T, strict=True)]
    dq = np.column_stack(late) if measured else None
    return Recording(bag.name, bag.joint_names, bag.time, bag.q, dq, bag.tau, bag.dead_effort)


def test_the_lag_is_estimated_and_ignored_below_two_milliseconds(arm) -> None:
    motions = [aperiodic_motion(late_recording(arm, noise)) for noise in (0.0, 1.0)]
    for bags in (motions[:1], motions[1:], motions):
        assert velocity_lag(bags, CUTOFF) == pytest.approx([0.0, 5e-3, -4e-3, 0.0], abs=2e-4)


def test_without_measured_velocities_the_lag_is_zero(arm) -> None:
    motion = aperiodic_motion(late_recording(arm, 0.0, measured=False))
    assert not velocity_lag([motion], CUTOFF).any()
