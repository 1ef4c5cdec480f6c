"""Units that are wrong are named as what they are."""

import numpy as np
import pytest

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.signal_checks import check_units

T = np.arange(0.0, 20.0, 0.01)
Q = np.column_stack([np.sin(T), 0.3 * np.cos(2.1 * T)])
DQ = np.column_stack([np.cos(T), -0.63 * np.sin(2.1 * T)])
JOINTS = ('a', 'b')


def test_a_motion_in_rad_is_fine_with_noise_and_a_filter() -> None:
    noise = 0.1 * np.random.default_rng(0).standard_normal(DQ.shape)
    check_units('bag', JOINTS, T, Q, DQ + noise)
    check_units('bag', JOINTS, T, Q, 0.8 * DQ)
    check_units('bag', JOINTS, T, Q, None)


def test_a_velocity_that_is_something_else_is_not_judged() -> None:
    check_units('bag', JOINTS, T, Q, 30.0 * np.random.default_rng(0).standard_normal(DQ.shape))
    check_units('bag', JOINTS, T, Q, np.zeros_like(DQ))


@pytest.mark.parametrize(
    ('time', 'q', 'dq', 'words'),
    [
        (T, np.degrees(Q), np.degrees(DQ), 'a moves by 115 rad, 18 turns, .* look like degrees'),
        (T, np.degrees(Q), None, 'positions look like degrees'),
        (T, Q, np.degrees(DQ), 'look like degrees per second'),
        (T, Q, 30.0 / np.pi * DQ, 'look like turns per minute'),
        (10.0 * T, Q, DQ, 'stamps run 10 times too slow'),
        (0.001 * T, Q, DQ, r'stamps run 1e\+03 times too fast'),
    ],
)
def test_units_that_are_wrong(time, q, dq, words: str) -> None:
    with pytest.raises(IdentificationError, match=words):
        check_units('bag', JOINTS, time, q, dq)
