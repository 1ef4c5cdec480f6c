import numpy as np
import pytest

from aerarm_ros.control.checks import (
    RejectedInputError,
    finite,
    non_negative,
    non_negative_number,
    positive,
)


@pytest.mark.parametrize(
    'names', [['joint1'], ['joint1'] * 4, ['joint1', 'joint2', 'joint3', 'joint5']]
)
def test_other_names_are_rejected(limits, names) -> None:
    with pytest.raises(RejectedInputError, match='name each of'):
        limits.order(names)


def test_the_joint_outside_is_named(limits) -> None:
    rows = np.tile(limits.position_max, (3, 1))
    rows[1, 2] += 0.1
    with pytest.raises(RejectedInputError, match=r'path: joint3 at 3\.067 rad'):
        limits.check_position('path', rows)
    with pytest.raises(RejectedInputError, match='joint4 needs 6 rad/s'):
        limits.check_velocity('path', np.array([0.0, 1.0, 2.0, -6.0]))
    with pytest.raises(RejectedInputError, match='1e-06 more than its limit'):
        limits.check_velocity('path', limits.velocity_max + [0.0, 1e-6, 0.0, 0.0])


def test_nan_is_never_inside(limits) -> None:
    with pytest.raises(RejectedInputError):
        limits.check_position('posture', np.array([0.0, np.nan, 0.0, 0.0]))
    with pytest.raises(RejectedInputError):
        limits.check_velocity('velocity', np.array([0.0, np.nan, 0.0, 0.0]))


def test_can_be_widened_to_a_posture(limits) -> None:
    beyond = limits.position_max + [0.0, 0.1, 0.0, 0.0]
    limits.including(beyond).check_position('posture', beyond)
    with pytest.raises(RejectedInputError):
        limits.check_position('posture', beyond)


def test_one_value_counts_for_all_joints_and_the_array_is_private() -> None:
    given = np.array([1.0, 2.0])
    gains = non_negative('kp', given, 2)
    given[0] = 9.0
    np.testing.assert_array_equal(gains, [1.0, 2.0])
    np.testing.assert_array_equal(non_negative('kp', 3.0, 2), [3.0, 3.0])
    np.testing.assert_array_equal(finite('rest', [-1.0, 0.0], 2), [-1.0, 0.0])


@pytest.mark.parametrize(
    ('check', 'message'),
    [
        (lambda: non_negative('kp', [1.0, 2.0, 3.0], 2), 'kp has 3 values, 2 are needed'),
        (lambda: non_negative('kp', [1.0, -2.0], 2), 'kp = .* must not be negative'),
        (lambda: non_negative('kp', [1.0, np.inf], 2), 'kp = .* must be finite'),
        (lambda: finite('rest', [0.0, np.nan], 2), 'rest = .* must be finite'),
        (lambda: non_negative_number('latency', -1.0), 'latency = .* must not be negative'),
        (lambda: positive('width', 0.0), 'width = 0.0 must be positive'),
        (lambda: positive('width', np.nan), 'width = nan must be positive'),
    ],
)
def test_the_error_names_the_invalid_gain(check, message) -> None:
    with pytest.raises(ValueError, match=message):
        check()
