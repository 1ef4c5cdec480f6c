"""Resampling onto a grid that fits the period, and finding the motion."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.periodicity import PeriodicPart
from aerarm_ros.identification.conditioning.uniform_motion import (
    aperiodic_motion,
    periodic_motion,
    sampling_time,
)
from aerarm_ros.identification.errors import IdentificationError


def test_a_period_gets_a_whole_number_of_decimated_samples(make_arm: Callable) -> None:
    recording = make_arm(rate=100.0).recording(1, f0=0.0737)
    motion = periodic_motion(recording, PeriodicPart(3.0, 1.0 / 0.0737, 2), 7)
    assert motion.period is not None
    assert motion.period % 7 == 0
    assert motion.period * motion.dt == pytest.approx(1.0 / 0.0737)
    assert motion.count == 2 * motion.period
    assert motion.periods == 2
    assert motion.time[motion.window][0] == pytest.approx(3.0)
    exact = [np.interp(motion.time, recording.time, column) for column in recording.q.T]
    assert np.allclose(motion.q.T, exact)


def test_a_recording_of_exactly_two_periods_is_used_completely(make_arm: Callable) -> None:
    whole = make_arm(rate=100.0).recording(1)
    cut = whole.part(3.0 / whole.duration, 22.9901 / whole.duration, '')
    motion = periodic_motion(cut, PeriodicPart(cut.time[0], 10.0, 2), 10)
    assert motion.count == len(motion.time) == 2000


def test_standing_still_at_the_ends_is_left_out(make_arm: Callable) -> None:
    recording = make_arm(rate=100.0).recording(1, still=4.0)
    motion = aperiodic_motion(recording)
    assert motion.period is None
    assert motion.periods == 0
    window = motion.time[motion.window]
    assert 4.0 < window[0] < 4.5
    assert 27.5 < window[-1] < 28.0


def test_a_short_motion_is_refused(make_arm: Callable) -> None:
    recording = make_arm(rate=100.0).recording(1)
    with pytest.raises(IdentificationError, match=r'only [12]\.\d+ s of motion, too short'):
        aperiodic_motion(recording.part(0.5, 0.5 + 2.5 / recording.duration, ''))


def test_sampling_time_ignores_gaps(make_arm: Callable) -> None:
    recording = make_arm(rate=100.0).recording(1)
    assert sampling_time(recording) == pytest.approx(0.01)
