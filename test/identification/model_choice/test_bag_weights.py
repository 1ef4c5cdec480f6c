"""A noisy bag counts less than a quiet one."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification import identify as identification
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify


def test_rows_count_by_one_over_their_noise(
    arm, robot: Robot, config: ArmConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    bags = [arm.recording(1, noise=0.5), arm.recording(3, noise=8.0)]
    options = IdentificationOptions(friction='coulomb', solvers=())
    errors = []
    for most in (10.0, 1.0):  # the second leaves all weights at one
        monkeypatch.setattr(identification, '_MOST', most)
        result = identify(robot, config, bags, [arm.recording(2)], options, Stopwatch())
        errors.append(result.recommended.validation[0].filtered)
        quiet, noisy = (bag.weights for bag in result.identification)
        if most > 1.0:
            assert quiet / noisy == pytest.approx(np.full(4, 16.0), rel=0.4)
    assert errors[0] < 0.8 * errors[1]


def test_one_bag_counts_once(result) -> None:
    assert np.array_equal(result.identification[0].weights, np.ones(4))
