"""The acceleration in PX4's set points, in PX4's axes; the node itself needs px4_msgs."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest

from aerarm_ros.nodes import px4_feedforward

OPEN = np.full(3, np.nan, dtype=np.float32)


def set_point(acceleration: np.ndarray) -> SimpleNamespace:
    """Return the fields of a TrajectorySetpoint that holds a place."""
    return SimpleNamespace(
        timestamp=1, position=np.array([1.0, 2.0, -3.0], dtype=np.float32), velocity=OPEN,
        acceleration=acceleration, jerk=OPEN, yaw=0.5, yawspeed=float('nan'),
    )  # fmt: skip


@pytest.mark.parametrize('asked', [OPEN, np.array([0.1, 0.2, 0.3], dtype=np.float32)])
def test_the_acceleration_is_added_north_east_down_and_other_fields_stay(asked: np.ndarray) -> None:
    before = set_point(asked)
    after = px4_feedforward.add_acceleration(before, np.array([1.0, 2.0, 0.5]), 7_000_000)
    expected = np.nan_to_num(asked) + [2.0, 1.0, -0.5]
    np.testing.assert_allclose(after.acceleration, expected, rtol=1e-6)
    assert after.acceleration.dtype == np.float32
    assert after.timestamp == 7000
    np.testing.assert_array_equal(before.acceleration, asked)
    np.testing.assert_array_equal(after.position, before.position)
    assert np.isnan(after.velocity).all()
    assert after.yaw == 0.5


def test_an_axis_without_a_set_point_stays_open() -> None:
    before = set_point(OPEN)
    before.position = np.array([1.0, np.nan, np.nan], dtype=np.float32)
    before.velocity = np.array([np.nan, 0.2, np.nan], dtype=np.float32)
    after = px4_feedforward.add_acceleration(before, np.array([1.0, 2.0, 0.5]), 0)
    np.testing.assert_allclose(after.acceleration, [2.0, 1.0, np.nan])


def test_the_offboard_mode_is_that_of_the_first_set_point_that_is_given() -> None:
    before = set_point(OPEN)
    assert px4_feedforward.controlled_quantity(before) == 'position'
    before.position = OPEN
    before.velocity = np.array([np.nan, 0.2, np.nan], dtype=np.float32)
    assert px4_feedforward.controlled_quantity(before) == 'velocity'
    before.velocity = OPEN
    assert px4_feedforward.controlled_quantity(before) == 'acceleration'


@pytest.mark.skipif(find_spec('px4_msgs') is not None, reason='px4_msgs is installed')
def test_without_px4_msgs_it_says_what_to_do(ros_domain, capsys) -> None:
    assert px4_feedforward.main([]) == 1
    assert 'mavros_feedforward' in capsys.readouterr().err
