import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError


def test_come_from_the_configuration(limits, config) -> None:
    assert limits.names == config.joint_names
    np.testing.assert_array_equal(limits.position_max, config.column('position_max'))


def test_order_finds_joints_by_name(limits) -> None:
    assert limits.order(['joint2', 'joint1', 'joint4', 'joint3']) == [1, 0, 3, 2]


@pytest.mark.parametrize(
    'names', [['joint1'], ['joint1'] * 4, ['joint1', 'joint2', 'joint3', 'joint5']]
)
def test_other_names_are_rejected(limits, names) -> None:
    with pytest.raises(RejectedInputError, match='name each of'):
        limits.order(names)


def test_the_limits_themselves_are_allowed(limits) -> None:
    limits.check_position('posture', limits.position_min)
    limits.check_position('postures', np.array([limits.position_min, limits.position_max]))
    limits.check_velocity('velocity', -limits.velocity_max)


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
