"""Whole periods, resampling onto a grid that fits them, and the motion between rests."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.motion_check import (
    PeriodicPart,
    count_harmonics,
    find_periodic_part,
)
from aerarm_ros.identification.conditioning.uniform_motion import aperiodic_motion, periodic_motion
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


@pytest.mark.parametrize(('f0', 'harmonics', 'periods'), [(0.1, 5, 2), (0.5, 3, 4), (0.0737, 4, 2)])
def test_period_and_harmonics_are_found(
    make_arm: Callable, f0: float, harmonics: int, periods: int
) -> None:
    arm = make_arm(rate=100.0)
    t, q, dq, _ = arm.motion(3, periods=periods, f0=f0, harmonics=harmonics)
    part = find_periodic_part(t, q + 1e-4 * np.random.default_rng(0).standard_normal(q.shape))
    assert part is not None
    assert part.fundamental == pytest.approx(f0, rel=1e-3)
    assert part.periods == periods
    assert part.start == pytest.approx(3.0, abs=0.03 * periods / f0 * 0.2 + 0.2)
    inside = (t >= part.start - 1e-9) & (t < part.start + periods * part.period - 1e-9)
    assert count_harmonics(dq[inside], periods) == harmonics


def test_one_period_is_found_if_its_frequency_is_known(make_arm: Callable) -> None:
    t, q, _, _ = make_arm(rate=100.0).motion(4, periods=1)
    assert find_periodic_part(t, q) is None
    part = find_periodic_part(t, q, fundamental=0.1)
    assert part is not None
    assert part.periods == 1
    assert part.start == pytest.approx(3.0, abs=0.3)


def test_standing_still_is_no_period(make_arm: Callable) -> None:
    """Rest repeats itself perfectly, which must not count."""
    t, q, _, _ = make_arm(rate=50.0).motion(1, still=25.0)
    part = find_periodic_part(t, q)
    assert part is not None
    assert part.start == pytest.approx(27.0, abs=0.3)
    assert part.periods == 2


@pytest.mark.parametrize('seed', range(5))
def test_wandering_is_not_periodic(seed: int) -> None:
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 30.0, 0.02)
    q = np.cumsum(np.cumsum(random.standard_normal((len(t), 3)), axis=0), axis=0) * 1e-3
    assert find_periodic_part(t, q) is None
