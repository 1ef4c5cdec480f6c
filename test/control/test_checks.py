"""Checks of numbers and limits; the tests of references and laws cover what their errors name."""

import numpy as np
import pytest

from aerarm_ros.control.checks import (
    RejectedInputError,
    finite,
    non_negative,
    non_negative_number,
    positive,
)


def test_the_joint_outside_is_named_and_nan_is_never_inside(limits) -> None:
    rows = np.tile(limits.position_max, (3, 1))
    rows[1, 2] += 0.1
    nan = np.array([0.0, np.nan, 0.0, 0.0])
    for check, values, reason in (
        (limits.check_position, rows, r'path: joint3 at 3\.067 rad'),
        (limits.check_velocity, np.array([0.0, 1.0, 2.0, -6.0]), 'joint4 needs 6 rad/s'),
        (limits.check_velocity, limits.velocity_max + [0, 1e-6, 0, 0], '1e-06 more than its limit'),
        (limits.check_position, nan, 'joint2 at nan'),
        (limits.check_velocity, nan, 'joint2 needs nan'),
    ):
        with pytest.raises(RejectedInputError, match=reason):
            check('path', values)
    limits.including(rows[1]).check_position('posture', rows)


@pytest.mark.parametrize(
    ('check', 'message'),
    [
        (lambda: non_negative('kp', [1.0, 2.0, 3.0], 2), 'kp has 3 values, 2 are needed'),
        (lambda: non_negative('kp', [1.0, -2.0], 2), 'kp = .* must not be negative'),
        (lambda: finite('rest', [0.0, np.nan], 2), 'rest = .* must be finite'),
        (lambda: non_negative_number('latency', -1.0), 'latency = .* must not be negative'),
        (lambda: positive('width', 0.0), 'width = 0.0 must be positive'),
        (lambda: positive('width', np.nan), 'width = nan must be positive'),
    ],
)
def test_the_error_names_the_invalid_gain(check, message) -> None:
    with pytest.raises(ValueError, match=message):
        check()
