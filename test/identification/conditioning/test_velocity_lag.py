"""A velocity that comes late is found without any model of the arm."""

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.conditioning import velocity_lag
from aerarm_ros.identification.conditioning.uniform_motion import aperiodic_motion
from aerarm_ros.identification.recording.recording import Recording

CUTOFF = 5.0
LATE = np.array([0.0, 5e-3, -4e-3, 1e-3])


def recording(arm, noise: float, measured: bool = True) -> Recording:
    bag = arm.recording(1, noise=noise)
    late = [np.interp(bag.time - d, bag.time, v) for d, v in zip(LATE, bag.dq.T, strict=True)]
    dq = np.column_stack(late) if measured else None
    return Recording(bag.name, bag.joint_names, bag.time, bag.q, dq, bag.tau, bag.dead_effort)


def test_the_lag_is_estimated_and_ignored_below_two_milliseconds(arm) -> None:
    motions = [aperiodic_motion(recording(arm, noise)) for noise in (0.0, 1.0)]
    for bags in (motions[:1], motions[1:], motions):
        assert velocity_lag(bags, CUTOFF) == pytest.approx([0.0, 5e-3, -4e-3, 0.0], abs=2e-4)


def test_without_measured_velocities_the_lag_is_zero(arm) -> None:
    motion = aperiodic_motion(recording(arm, 0.0, measured=False))
    assert not velocity_lag([motion], CUTOFF).any()
