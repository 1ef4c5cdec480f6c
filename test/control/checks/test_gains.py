import numpy as np
import pytest

from aerarm_ros.control.checks import finite, non_negative, non_negative_number, positive


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
