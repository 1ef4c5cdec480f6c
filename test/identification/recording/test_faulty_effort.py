"""Spikes and saturation of recorded efforts."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.identification.identification_result import IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import JointMapping, recording_from_states
from aerarm_ros.identification.recording.signal_checks import saturated_effort, without_spikes

T = np.arange(0.0, 10.0, 1e-3)[:, None]
Q = np.sin(T)
JOINTS = ('elbow',)


def noisy_torque() -> np.ndarray:
    random = np.random.default_rng(1)
    return 3.0 * np.sin(T) + np.sign(np.cos(T)) + 0.1 * random.standard_normal(T.shape)


def test_sound_efforts_stay_as_they_are() -> None:
    tau = noisy_torque()
    same, told = without_spikes('bag', JOINTS, tau)
    assert same is tau
    assert saturated_effort('bag', JOINTS, Q, tau) == (None, [])
    assert told == []


def test_spikes_are_bridged() -> None:
    sound = noisy_torque()
    tau = sound.copy()
    tau[[500, 501, 7000], 0] = [80.0, 90.0, -70.0]
    bridged, (text,) = without_spikes('bag', JOINTS, tau)
    assert '3 spikes in the effort of elbow' in text
    assert tau[500, 0] == 80.0
    assert np.abs(bridged - sound).max() < 1.0


def test_a_torque_that_jumps_often_has_no_spikes() -> None:
    tau = np.where(np.arange(len(T)) % 50 == 0, 50.0, 0.1 * np.sin(T[:, 0]))[:, None]
    assert without_spikes('bag', JOINTS, tau)[1] == []


def test_an_effort_held_at_its_limit_is_saturated() -> None:
    tau = np.clip(noisy_torque(), -10.0, 3.0)
    mask, (text,) = saturated_effort('bag', JOINTS, Q, tau)
    assert 'elbow is saturated' in text
    assert mask is not None
    assert np.all(tau[mask] == 3.0)
    assert mask.sum() > 0.8 * (tau == 3.0).sum()


def test_an_effort_that_rests_with_its_joint_is_not() -> None:
    q, tau = Q.copy(), noisy_torque()
    q[:2000], tau[:2000] = q[2000], 5.0
    assert saturated_effort('bag', JOINTS, q, tau) == (None, [])


def identified(arm, config: ArmConfig, spoil: Callable) -> IdentificationResult:
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
    found = identified(arm, config, spoil)
    sound, spoilt = (r.recommended.validation[0].filtered for r in (result, found))
    assert spoilt < 1.3 * sound
    assert any(words in text and 'joint2' in text for text in found.warnings)
