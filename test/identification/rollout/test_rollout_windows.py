"""Windows are pieces of the motion as it was recorded."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.rollout import RolloutWindows


def test_they_are_half_seconds_of_the_motion(arm, robot, samples_of) -> None:
    samples = samples_of(arm.recording(1))
    windows = RolloutWindows.of(robot, [samples])
    assert windows.count == 39  # of 20 s, the last one cut short by the filter's edge
    assert windows.dt * (windows.q.shape[1] - 1) == pytest.approx(0.5, abs=windows.dt)
    first = int(np.flatnonzero((samples.q == windows.q[0, 0]).all(axis=1))[0])
    rows = slice(first, first + windows.q.shape[1])
    np.testing.assert_array_equal(windows.tau[0], samples.tau[rows])
    twice = RolloutWindows.of(robot, [samples, samples])
    assert twice.count == 2 * windows.count


def test_unmeasured_samples_are_omitted(arm, robot, samples_of) -> None:
    samples = samples_of(arm.recording(1))
    measured = samples.measured.copy()
    measured[: len(measured) // 2, 2] = False
    windows = RolloutWindows.of(robot, [replace(samples, measured=measured)])
    assert 0 < windows.count <= 20
    nothing = replace(samples, measured=np.zeros_like(measured))
    assert RolloutWindows.of(robot, [nothing]).count == 0
