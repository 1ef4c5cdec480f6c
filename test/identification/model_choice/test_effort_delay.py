"""Efforts that come late are found to a millisecond, and moved to where they belong."""

import json
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.files.summary import summarise
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import Recording

EFFORT = np.array([5e-3, 5e-3, -5e-3, 0.0])
VELOCITY = np.array([0.0, 8e-3, 0.0, 0.0])


def late(bag: Recording, values: np.ndarray, delay: np.ndarray) -> np.ndarray:
    pairs = zip(delay, values.T, strict=True)
    return np.column_stack([np.interp(bag.time - d, bag.time, v) for d, v in pairs])


def run(robot: Robot, config: ArmConfig, bag: Recording, exact: bool = False):
    conditioning = ConditioningOptions(exact_stamps=exact)
    options = IdentificationOptions(conditioning, friction='coulomb')
    return identify(robot, config, [bag], [], options, Stopwatch())


def test_a_delay_of_five_milliseconds_is_found(arm, robot: Robot, config: ArmConfig) -> None:
    bag = arm.recording(1, noise=1.0)
    moved = replace(bag, tau=late(bag, bag.tau, EFFORT), dq=late(bag, bag.dq, VELOCITY))
    found = run(robot, config, moved)
    assert found.delay.found == pytest.approx(EFFORT, abs=1e-3)
    assert np.all((found.delay.deviation > 0.0) & (found.delay.deviation < 2e-3))
    assert np.all(np.abs(found.delay.found - EFFORT) < 3.0 * found.delay.deviation)
    assert found.conditioner.delays.velocity == pytest.approx(VELOCITY, abs=2e-4)
    used = found.delay.used
    assert used[0] == pytest.approx(5e-3, abs=1e-3)
    assert np.array_equal(found.conditioner.delays.effort, used)
    # What a summary holds are plain numbers.
    assert json.loads(json.dumps(summarise(found, {})))['delays']['velocity_used'] is True
    trusting = run(robot, config, moved, exact=True)
    assert trusting.delay is None
    before, after = (each.recommended.identification[0].filtered for each in (trusting, found))
    assert after < 0.8 * before


def test_signals_of_one_instant_are_left_alone(result) -> None:
    assert np.abs(result.delay.found).max() < 1e-3
    assert not result.conditioner.delays.effort.any()
    assert not result.conditioner.delays.velocity.any()
