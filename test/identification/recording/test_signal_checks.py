"""Small disorder of stamps and efforts is repaired, faults and wrong units are refused."""

from collections.abc import Callable

import numpy as np
import pytest
from identified import identified

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.recording.recording import JointMapping, recording_from_states
from aerarm_ros.identification.recording.signal_checks import (
    check_stamp_unit,
    check_units,
    saturated_effort,
    usable_messages,
    without_spikes,
)

INDEX = np.arange(5000)
STAMP = 100.0 + 1e-3 * INDEX


@pytest.mark.parametrize(
    ('change', 'lost', 'words'),
    [
        (lambda s: s + 2e-4 * np.random.default_rng(0).uniform(-1, 1, len(s)), 0, ''),
        (lambda s: np.delete(s, [100, 101, 102, 2000]), 0, ''),
        (lambda s: np.where(np.arange(len(s)) == 700, s[699], s), 1, 'repeated'),
        (lambda s: s[[*range(50), 51, 50, *range(52, len(s))]], 0, 'order'),
    ],
    ids=['jitter', 'lost', 'repeated', 'swapped'],
)
def test_small_disorder_of_stamps_is_repaired(change: Callable, lost: int, words: str) -> None:
    stamp = change(STAMP)
    kept, warnings = usable_messages('bag', stamp)
    assert len(kept) == len(stamp) - lost
    assert words in ''.join(warnings)
    assert bool(warnings) == bool(words)
    assert np.all(np.diff(stamp[kept]) > 0.0)


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (lambda s: np.full_like(s, 3.0), 'same stamp'),
        (
            lambda s: np.where(np.abs(INDEX - 1100) < 100, s[1001], s),
            '198 of 5000 stamps of bag re',
        ),
        (lambda s: s - (INDEX >= 2500), 'repeat an earlier|jump back'),
        (lambda s: s - 0.0504 * (INDEX >= 4800), 'jump back'),  # by less than a gap
        (lambda s: s + 5.0 * (INDEX >= 2500), 'bag has no joint states for 5.001 s at 2.50 s of'),
        (lambda s: np.where(INDEX == 10, np.nan, s), 'not finite'),
    ],
    ids=['constant', 'repeated', 'backwards', 'set back', 'jump', 'nan'],
)
def test_faults_are_refused_with_advice(change: Callable, text: str) -> None:
    with pytest.raises(IdentificationError, match=text) as caught:
        usable_messages('bag', change(STAMP))
    assert 'record again' in str(caught.value)


def test_a_gap_is_placed_in_the_bag_and_in_the_used_part() -> None:
    with pytest.raises(IdentificationError, match=r'at 12.50 s of the bag \(2.50 s of the used'):
        usable_messages('bag', STAMP + 5.0 * (INDEX >= 2500), begin=90.0)


def test_stamps_that_are_no_seconds() -> None:
    check_stamp_unit('bag', STAMP)
    check_stamp_unit('bag', np.full(5, 3.0))
    for factor, unit in ((1e3, 'milliseconds'), (1e6, 'microseconds'), (1e9, 'nanoseconds')):
        with pytest.raises(IdentificationError, match=f's apart, so their stamps look like {unit}'):
            check_stamp_unit('bag', factor * 5.0 * STAMP)


T = np.arange(0.0, 20.0, 0.01)
Q = np.column_stack([np.sin(T), 0.3 * np.cos(2.1 * T)])
DQ = np.column_stack([np.cos(T), -0.63 * np.sin(2.1 * T)])
NOISE = np.random.default_rng(0).standard_normal(DQ.shape)
JOINTS = ('a', 'b')


@pytest.mark.parametrize('dq', [DQ + 0.1 * NOISE, 0.8 * DQ, None, 30.0 * NOISE, np.zeros_like(DQ)])
def test_units_are_not_judged_by_noise_and_filters(dq: np.ndarray | None) -> None:
    check_units('bag', JOINTS, T, Q, dq)


@pytest.mark.parametrize(
    ('time', 'q', 'dq', 'words'),
    [
        (T, np.degrees(Q), np.degrees(DQ), 'a moves by 115 rad, 18 turns, .* look like degrees'),
        (T, np.degrees(Q), None, 'positions look like degrees'),
        (T, Q, np.degrees(DQ), 'look like degrees per second'),
        (T, Q, 30.0 / np.pi * DQ, 'look like turns per minute'),
        (10.0 * T, Q, DQ, 'stamps run 10 times too slow'),
        (0.001 * T, Q, DQ, r'stamps run 1e\+03 times too fast'),
    ],
)
def test_units_that_are_wrong(time, q, dq, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        check_units('bag', JOINTS, time, q, dq)


TIME = np.arange(0.0, 10.0, 1e-3)[:, None]
ANGLE = np.sin(TIME)
ELBOW = ('elbow',)


def noisy_torque() -> np.ndarray:
    random = np.random.default_rng(1)
    return 3.0 * np.sin(TIME) + np.sign(np.cos(TIME)) + 0.1 * random.standard_normal(TIME.shape)


def test_spikes_are_bridged_and_sound_efforts_stay_as_they_are() -> None:
    sound = noisy_torque()
    same, told = without_spikes('bag', ELBOW, sound)
    assert same is sound
    assert told == []
    tau = sound.copy()
    tau[[500, 501, 7000], 0] = [80.0, 90.0, -70.0]
    bridged, (text,) = without_spikes('bag', ELBOW, tau)
    assert '3 spikes in the effort of elbow' in text
    assert tau[500, 0] == 80.0
    assert np.abs(bridged - sound).max() < 1.0


def test_an_effort_held_at_its_limit_while_the_joint_moves_is_saturated() -> None:
    sound = noisy_torque()
    tau = np.clip(sound, -10.0, 3.0)
    mask, (text,) = saturated_effort('bag', ELBOW, ANGLE, tau)
    assert 'elbow is saturated' in text
    assert mask is not None
    assert np.all(tau[mask] == 3.0)
    assert mask.sum() > 0.8 * (tau == 3.0).sum()
    q, resting = ANGLE.copy(), sound.copy()
    q[:2000], resting[:2000] = q[2000], 5.0
    for angle, effort in ((ANGLE, sound), (q, resting)):
        assert saturated_effort('bag', ELBOW, angle, effort) == (None, [])


def add_spikes(tau: np.ndarray) -> None:
    tau[np.random.default_rng(3).choice(np.arange(2000, 10000), 20, replace=False)] += 200.0


def clip(tau: np.ndarray) -> None:
    np.clip(tau, -0.5 * np.abs(tau).max(), 0.5 * np.abs(tau).max(), out=tau)


@pytest.mark.parametrize(('spoil', 'words'), [(add_spikes, '20 spikes'), (clip, 'saturated')])
def test_another_motion_is_predicted_as_if_efforts_were_sound(
    arm, result: IdentificationResult, spoil: Callable, words: str
) -> None:
    states = arm.states(1, noise=1.0)
    spoil(states.effort[:, 1])
    bag = recording_from_states('bag', states, states.names, JointMapping({}))
    found = identified(bag, arm.recording(2, noise=1.0))
    sound, spoilt = (r.recommended.validation[0].filtered for r in (result, found))
    assert spoilt < 1.3 * sound
    assert any(words in text and 'joint2' in text for text in found.warnings)
