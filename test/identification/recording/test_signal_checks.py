"""Small disorder of stamps and efforts is repaired, faults and wrong units are refused."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import JointMapping, recording_from_states
from aerarm_ros.identification.recording.signal_checks import (
    check_stamp_unit,
    check_units,
    saturated_effort,
    usable_messages,
    without_spikes,
)

STAMP = 100.0 + 1e-3 * np.arange(5000)


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


def broken(kind: str) -> np.ndarray:
    stamp = STAMP.copy()
    if kind == 'constant':
        stamp[:] = 3.0
    elif kind == 'repeated':
        stamp[1000:1200] = stamp[1000]
    elif kind == 'backwards':
        stamp[2500:] -= 1.0
    elif kind == 'jump':
        stamp[2500:] += 5.0
    else:
        stamp[10] = np.nan
    return stamp


@pytest.mark.parametrize(
    ('kind', 'text'),
    [
        ('constant', 'same stamp'),
        ('repeated', '199 of 5000 stamps of bag repeat an earlier'),
        ('backwards', 'repeat an earlier|jump back'),
        ('jump', r'bag has no joint states for 5.001 s at 2.50 s of the bag, because the recorder'),
        ('nan', 'not finite'),
    ],
)
def test_faults_are_refused_with_advice(kind: str, text: str) -> None:
    with pytest.raises(IdentificationError, match=text) as caught:
        usable_messages('bag', broken(kind))
    assert 'record again' in str(caught.value)


def test_a_gap_is_placed_in_the_bag_and_in_the_used_part() -> None:
    with pytest.raises(IdentificationError, match=r'at 12.50 s of the bag \(2.50 s of the used'):
        usable_messages('bag', broken('jump'), begin=90.0)


def test_a_clock_set_back_by_less_than_a_gap_is_refused() -> None:
    stamp = 1e-3 * np.arange(20_000)
    stamp[9_000:] -= 0.0504
    with pytest.raises(IdentificationError, match='jump back'):
        usable_messages('bag', stamp)


def test_stamps_that_are_no_seconds() -> None:
    check_stamp_unit('bag', STAMP)
    check_stamp_unit('bag', np.full(5, 3.0))
    for factor, unit in ((1e3, 'milliseconds'), (1e6, 'microseconds'), (1e9, 'nanoseconds')):
        with pytest.raises(IdentificationError, match=f's apart, so their stamps look like {unit}'):
            check_stamp_unit('bag', factor * 5.0 * STAMP)


T = np.arange(0.0, 20.0, 0.01)
Q = np.column_stack([np.sin(T), 0.3 * np.cos(2.1 * T)])
DQ = np.column_stack([np.cos(T), -0.63 * np.sin(2.1 * T)])
JOINTS = ('a', 'b')


def test_a_motion_in_rad_is_fine_with_noise_and_a_filter() -> None:
    noise = 0.1 * np.random.default_rng(0).standard_normal(DQ.shape)
    check_units('bag', JOINTS, T, Q, DQ + noise)
    check_units('bag', JOINTS, T, Q, 0.8 * DQ)
    check_units('bag', JOINTS, T, Q, None)


def test_a_velocity_that_is_something_else_is_not_judged() -> None:
    check_units('bag', JOINTS, T, Q, 30.0 * np.random.default_rng(0).standard_normal(DQ.shape))
    check_units('bag', JOINTS, T, Q, np.zeros_like(DQ))


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


def test_sound_efforts_stay_as_they_are() -> None:
    tau = noisy_torque()
    same, told = without_spikes('bag', ELBOW, tau)
    assert same is tau
    assert saturated_effort('bag', ELBOW, ANGLE, tau) == (None, [])
    assert told == []


def test_spikes_are_bridged() -> None:
    sound = noisy_torque()
    tau = sound.copy()
    tau[[500, 501, 7000], 0] = [80.0, 90.0, -70.0]
    bridged, (text,) = without_spikes('bag', ELBOW, tau)
    assert '3 spikes in the effort of elbow' in text
    assert tau[500, 0] == 80.0
    assert np.abs(bridged - sound).max() < 1.0


def test_an_effort_held_at_its_limit_is_saturated() -> None:
    tau = np.clip(noisy_torque(), -10.0, 3.0)
    mask, (text,) = saturated_effort('bag', ELBOW, ANGLE, tau)
    assert 'elbow is saturated' in text
    assert mask is not None
    assert np.all(tau[mask] == 3.0)
    assert mask.sum() > 0.8 * (tau == 3.0).sum()


def test_an_effort_that_rests_with_its_joint_is_not() -> None:
    q, tau = ANGLE.copy(), noisy_torque()
    q[:2000], tau[:2000] = q[2000], 5.0
    assert saturated_effort('bag', ELBOW, q, tau) == (None, [])


def spoiled(arm, config: ArmConfig, spoil: Callable) -> IdentificationResult:
    states = arm.states(1, noise=1.0)
    spoil(states.effort[:, 1])
    names = arm.robot.joint_names
    bag = recording_from_states('bag', states, names, JointMapping({}))
    other = arm.recording(2, noise=1.0)
    options = IdentificationOptions(friction='coulomb')
    return identify(arm.robot, config, [bag], [other], options, Stopwatch())


def add_spikes(tau: np.ndarray) -> None:
    tau[np.random.default_rng(3).choice(np.arange(2000, 10000), 20, replace=False)] += 200.0


def clip(tau: np.ndarray) -> None:
    np.clip(tau, -0.5 * np.abs(tau).max(), 0.5 * np.abs(tau).max(), out=tau)


@pytest.mark.parametrize(('spoil', 'words'), [(add_spikes, '20 spikes'), (clip, 'saturated')])
def test_another_motion_is_predicted_as_if_efforts_were_sound(
    arm, config: ArmConfig, result: IdentificationResult, spoil: Callable, words: str
) -> None:
    found = spoiled(arm, config, spoil)
    sound, spoilt = (r.recommended.validation[0].filtered for r in (result, found))
    assert spoilt < 1.3 * sound
    assert any(words in text and 'joint2' in text for text in found.warnings)
