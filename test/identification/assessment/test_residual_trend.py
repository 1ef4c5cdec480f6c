"""Friction that falls as gears get warm is told from noise and from an offset."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.assessment import residual_trend, trend_warnings


def test_changes_of_friction_and_offset_are_named(result, robot) -> None:
    (bag,), (assessed,) = result.identification, result.recommended.identification
    samples = bag.samples
    quiet = residual_trend(bag, assessed)
    assert trend_warnings([quiet], robot.joint_names) == []
    age = np.linspace(-0.5, 0.5, len(samples.time))
    tau = samples.tau.copy()
    tau[:, 1] -= 0.5 * age * np.tanh(samples.dq[:, 1] / 0.02)
    tau[:, 2] += 0.2 * age
    found = residual_trend(bag.altered(samples=replace(samples, tau=tau)), assessed)
    assert found.friction == pytest.approx([0.0, -0.5, 0.0, 0.0], abs=0.05)
    assert found.offset == pytest.approx([0.0, 0.0, 0.2, 0.0], abs=0.02)
    told = trend_warnings([found], robot.joint_names)
    assert len(told) == 2
    assert 'the friction changes' in told[0]
    assert 'joint2 by -0.5' in told[0]
    assert 'the torque offset changes' in told[1]
    assert 'joint3 by +0.2' in told[1]


def test_a_short_motion_shows_no_trend(result) -> None:
    (bag,), (assessed,) = result.identification, result.recommended.identification
    samples = replace(bag.samples, time=0.1 * bag.samples.time)
    trend = residual_trend(bag.altered(samples=samples), assessed)
    assert not trend.friction.any()
    assert not trend.offset.any()
