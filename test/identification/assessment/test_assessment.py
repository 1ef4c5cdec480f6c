"""Torque errors (5.3), extrapolation, and trends of the residual."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identification_result import IdentificationResult, torque_errors
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify


def test_a_joint_of_which_nothing_was_measured_does_not_count() -> None:
    measured = np.array([[3.0, np.nan], [4.0, np.nan]])
    total, per_joint = torque_errors(measured, np.array([[3.0, 9.0], [3.0, 9.0]]))
    assert total == pytest.approx(20.0)
    assert np.array_equal(np.isnan(per_joint), [False, True])


def test_a_similar_motion_is_no_extrapolation(result: IdentificationResult) -> None:
    identification, validation = result.demands
    assert (identification.bag, validation.bag) == ('bag1', 'bag2')
    assert np.all(identification.beyond == 0.0)
    assert np.all(identification.uncertainty < result.fit.noise.std)
    assert not any('excites' in text for text in result.warnings)


def test_a_joint_that_rested_is_uncertain(
    make_arm: Callable, robot: Robot, config: ArmConfig
) -> None:
    arm = make_arm()
    bag = arm.recording(1, noise=1.0)
    t, q, dq, ddq = arm.motion(1)
    q[:, 3] = q[0, 3]
    dq[:, 3] = ddq[:, 3] = 0.0
    noise = 0.05 * np.random.default_rng(0).standard_normal(q.shape)
    still = replace(bag, time=t, q=q, dq=dq, tau=arm.torque(q, dq, ddq) + noise)
    options = IdentificationOptions(friction='coulomb')
    result = identify(robot, config, [still], [bag], options, Stopwatch())
    velocity = next(text for text in result.warnings if 'velocity leaves the range' in text)
    assert velocity.startswith('bag1: ')
    assert 'joint4, which hardly moves in the identification motion' in velocity
    assert any('hardly excites' in text and 'joint4' in text for text in result.warnings)
    assert 'fs_joint4' in result.only_prior
    assert result.demands[1].uncertainty[3] > 3.0 * result.demands[0].uncertainty[3]
