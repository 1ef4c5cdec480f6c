"""The acceleration on MAVROS's set points; the node itself needs mavros_msgs."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from std_msgs.msg import Header

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.nodes import mavros_feedforward

IGNORE_VELOCITY, IGNORE_ACCELERATION, IS_FORCE, IGNORE_YAW = 56, 448, 512, 1024
ADDED = np.array([1.0, -2.0, 0.5])


def set_point(type_mask: int, frame: int = 1) -> SimpleNamespace:
    """Return the fields of a PositionTarget that concern the acceleration."""
    return SimpleNamespace(
        header=Header(), coordinate_frame=frame, type_mask=type_mask,
        acceleration_or_force=Vector3(x=0.1, y=0.2, z=0.3),
    )  # fmt: skip


@pytest.mark.parametrize(('ignored', 'own'), [(0, [0.1, 0.2, 0.3]), (IGNORE_ACCELERATION, [0] * 3)])
def test_it_is_added_to_what_is_asked_for(ignored: int, own: list[float]) -> None:
    before = set_point(IGNORE_VELOCITY | ignored)
    after = mavros_feedforward.add_acceleration(before, ADDED, 3_000_000_007)
    found = after.acceleration_or_force
    np.testing.assert_allclose([found.x, found.y, found.z], own + ADDED)
    assert after.type_mask == IGNORE_VELOCITY
    assert (after.header.stamp.sec, after.header.stamp.nanosec) == (3, 7)
    assert before.acceleration_or_force.x == 0.1


def test_a_heading_that_is_left_open_stays_so() -> None:
    before = set_point(IGNORE_VELOCITY | IGNORE_ACCELERATION | IGNORE_YAW)
    after = mavros_feedforward.add_acceleration(before, ADDED, 0)
    assert after.type_mask == IGNORE_VELOCITY | IGNORE_YAW


@pytest.mark.parametrize('unfit', [set_point(IS_FORCE), set_point(0, frame=8)])
def test_what_takes_no_acceleration_is_refused(unfit: SimpleNamespace) -> None:
    with pytest.raises(RejectedInputError, match='force|FRAME_LOCAL_NED'):
        mavros_feedforward.add_acceleration(unfit, ADDED, 0)


@pytest.mark.skipif(find_spec('mavros_msgs') is not None, reason='mavros_msgs is installed')
def test_without_mavros_msgs_it_says_what_to_do(ros_domain, capsys) -> None:
    assert mavros_feedforward.main([]) == 1
    assert 'mavros_msgs' in capsys.readouterr().err
