import numpy as np
import pytest

from aerarm_ros.control.base.base_motion import ImuSample
from aerarm_ros.control.checks import RejectedInputError

GOOD = {
    'stamp': 1.0,
    'attitude': np.array([0.0, 0.0, 0.0, 1.0]),
    'angular_velocity': np.zeros(3),
    'specific_force': np.array([0.0, 0.0, 9.81]),
}


def test_the_attitude_is_normalised() -> None:
    sample = ImuSample(**{**GOOD, 'attitude': np.array([0.0, 0.0, 0.0, 1.02])})
    np.testing.assert_allclose(sample.attitude, [0.0, 0.0, 0.0, 1.0])


def test_an_imu_without_attitude_is_fine() -> None:
    assert ImuSample(**{**GOOD, 'attitude': None}).attitude is None


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'attitude': np.zeros(4)}, 'if the IMU has no attitude'),
        ({'attitude': np.array([0.0, 0.0, np.nan, 1.0])}, 'NaN'),
        ({'angular_velocity': np.array([np.nan, 0.0, 0.0])}, 'NaN'),
        ({'specific_force': np.array([0.0, np.inf, 0.0])}, 'NaN or infinite'),
        ({'specific_force': np.array([0.0, 0.0, 981.0])}, 'unit'),
        ({'angular_velocity': np.array([0.0, 0.0, 90.0])}, 'unit'),
    ],
)
def test_a_wrong_sample_is_rejected(changes, message) -> None:
    with pytest.raises(RejectedInputError, match=message):
        ImuSample(**{**GOOD, **changes})
