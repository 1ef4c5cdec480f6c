"""A base that doesn't stand level is noticed, one that does is believed."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify

TILT = np.radians([0.8, -1.1])  # about the base's x and y axes


def results(make_arm: Callable, robot: Robot, config: ArmConfig, lean: np.ndarray, **options):
    plain = make_arm(rate=200.0)
    leaning = replace(
        plain,
        robot=robot.with_gravity(
            robot.gravity_in_base + np.cross([*lean, 0.0], robot.gravity_in_base)
        ),
    )
    return identify(
        robot,
        config,
        [leaning.recording(1, noise=1.0)],
        [leaning.recording(2, noise=1.0)],
        IdentificationOptions(friction='coulomb', **options),
        Stopwatch(),
    )


def test_a_tilt_is_found_and_used(make_arm: Callable, robot: Robot, config: ArmConfig) -> None:
    found = results(make_arm, robot, config, TILT)
    gravity = found.gravity.used
    true = robot.gravity_in_base + np.cross([*TILT, 0.0], robot.gravity_in_base)
    assert np.linalg.norm(np.cross(gravity, true)) < np.radians(0.2) * gravity @ gravity
    assert np.linalg.norm(gravity) == pytest.approx(np.linalg.norm(found.gravity.stated))
    assert np.array_equal(found.robot.gravity_in_base, gravity)
    blind = results(make_arm, robot, config, TILT, tilt=False)
    assert blind.gravity is None
    assert found.recommended.validation[0].filtered < 0.8 * blind.recommended.validation[0].filtered
    # What slight tilts make of the rank is not the motion's merit.
    assert found.thesis_base.rank == blind.thesis_base.rank
    assert found.used_base.rank == blind.used_base.rank


def test_a_level_base_stays_level(result) -> None:
    assert result.gravity.tilt == 0.0
    assert np.array_equal(result.robot.gravity_in_base, result.gravity.stated)
    assert result.gravity.error > 0.95
