"""Stages joined end to end."""

import numpy as np
import pytest

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import MotionSequence, Stage, transfer

A, B, C = np.zeros(2), np.array([1.0, -1.0]), np.array([0.5, 0.5])


def leg(name: str, start: np.ndarray, end: np.ndarray, duration: float) -> Stage:
    return Stage(name, transfer(start, end, duration))


def test_stages_follow_each_other() -> None:
    motion = MotionSequence([leg('out', A, B, 1.0), leg('on', B, C, 2.0)])
    assert motion.duration == 3.0
    assert [motion.stage_at(t).name for t in (0.0, 0.99, 1.0, 5.0)] == ['out', 'out', 'on', 'on']
    np.testing.assert_allclose(motion.evaluate(1.0).q, B)
    np.testing.assert_allclose(motion.evaluate(9.0).q, C)


def test_many_times_agree_with_one_at_a_time() -> None:
    motion = MotionSequence([leg('out', A, B, 1.0), leg('on', B, C, 2.0)])
    time = np.random.default_rng(0).uniform(0.0, 3.0, 50)
    many = motion.evaluate(time)
    for i, t in enumerate(time):
        for rows, row in zip(many, motion.evaluate(t), strict=True):
            np.testing.assert_allclose(rows[i], row, atol=1e-14)


def test_a_gap_between_stages_is_refused() -> None:
    with pytest.raises(ExcitationError, match='on does not start where out ends'):
        MotionSequence([leg('out', A, B, 1.0), leg('on', C, A, 2.0)])
    with pytest.raises(ExcitationError, match='at least one'):
        MotionSequence([])
