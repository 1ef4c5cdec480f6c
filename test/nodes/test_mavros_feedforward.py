"""The acceleration on MAVROS's set points; the node itself needs mavros_msgs."""

from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Vector3
from std_msgs.msg import Header

from aerarm_ros.autopilot.ardupilot import LoopMotion
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.nodes import mavros_feedforward

IGNORE_POSITION, IGNORE_VELOCITY, IGNORE_ACCELERATION, IS_FORCE, IGNORE_YAW = 7, 56, 448, 512, 1024
ADDED = np.array([1.0, -2.0, 0.5])


def set_point(type_mask: int, frame: int = 1) -> SimpleNamespace:
    """Return the fields of a PositionTarget that concern the acceleration."""
    return SimpleNamespace(
        header=Header(), coordinate_frame=frame, type_mask=type_mask,
        velocity=Vector3(x=0.4, y=0.5, z=0.6), acceleration_or_force=Vector3(x=0.1, y=0.2, z=0.3),
    )  # fmt: skip


def values(vector: Vector3) -> list[float]:
    return [vector.x, vector.y, vector.z]


@pytest.mark.parametrize(('ignored', 'own'), [(0, [0.1, 0.2, 0.3]), (IGNORE_ACCELERATION, [0] * 3)])
def test_the_acceleration_is_added_to_that_of_the_set_point(ignored: int, own: list[float]) -> None:
    before = set_point(IGNORE_VELOCITY | ignored)
    after = mavros_feedforward.add_acceleration(before, ADDED, 3_000_000_007)
    np.testing.assert_allclose(values(after.acceleration_or_force), own + ADDED)
    assert after.type_mask == IGNORE_VELOCITY
    assert (after.header.stamp.sec, after.header.stamp.nanosec) == (3, 7)
    assert before.acceleration_or_force.x == 0.1


def test_axes_are_masked_one_by_one_for_px4() -> None:
    # x: position and its own acceleration; y: velocity alone; z: nothing at all.
    without_velocity_x, without_all_but_velocity_y, nothing_of_z = 8, 2 | 128, 4 | 32 | 256
    before = set_point(without_velocity_x | without_all_but_velocity_y | nothing_of_z)
    after = mavros_feedforward.add_acceleration(before, ADDED, 0)
    assert after.type_mask == without_velocity_x | 2 | nothing_of_z
    np.testing.assert_allclose(values(after.acceleration_or_force), [1.1, -2.0, 0.0])


@pytest.mark.parametrize(
    ('given', 'sent', 'velocity'),
    [
        # ArduCopter restarts GUIDED at a position with an acceleration and no velocity.
        (IGNORE_VELOCITY | IGNORE_ACCELERATION, 0, [0.0] * 3),
        (IGNORE_VELOCITY, 0, [0.0] * 3),
        (0b001_000 | IGNORE_ACCELERATION, 0, [0.0, 0.5, 0.6]),
        (IGNORE_ACCELERATION, 0, [0.4, 0.5, 0.6]),
        (IGNORE_POSITION | IGNORE_ACCELERATION, IGNORE_POSITION, [0.4, 0.5, 0.6]),
        (IGNORE_POSITION | IGNORE_VELOCITY, IGNORE_POSITION | IGNORE_VELOCITY, [0.4, 0.5, 0.6]),
        # Nothing that ArduCopter would follow: it goes on unchanged.
        (IGNORE_POSITION | IGNORE_VELOCITY | IGNORE_ACCELERATION,) * 2 + ([0.4, 0.5, 0.6],),
    ],
)
def test_ardupilot_gets_what_it_accepts(given: int, sent: int, velocity: list[float]) -> None:
    before = set_point(given | IGNORE_YAW)
    after = mavros_feedforward.add_acceleration(before, ADDED, 0, mavros_feedforward.ARDUPILOT)
    assert after.type_mask == sent | IGNORE_YAW
    assert values(after.velocity) == velocity


@pytest.mark.parametrize(
    ('unfit', 'autopilot', 'reason'),
    [
        (set_point(IS_FORCE), 'px4', 'force'),
        (set_point(0, frame=8), 'px4', 'FRAME_LOCAL_NED'),
        (set_point(0, frame=7), 'px4', 'coordinate_frame is 7'),
        (set_point(0, frame=8), 'ardupilot', 'FRAME_LOCAL_OFFSET_NED'),
    ],
)
def test_what_takes_no_acceleration_is_refused(
    unfit: SimpleNamespace, autopilot: str, reason: str
) -> None:
    with pytest.raises(RejectedInputError, match=reason):
        mavros_feedforward.add_acceleration(unfit, ADDED, 0, autopilot)


def test_a_position_moves_for_ardupilot_and_an_acceleration_stays() -> None:
    moved = LoopMotion(np.array([0.1, 0.2, 0.0]), np.array([0.3, 0.4, 0.0]), np.array([5, 6, 0.0]))
    before = set_point(IGNORE_VELOCITY | IGNORE_ACCELERATION)
    before.position = Vector3(x=1.0, y=2.0, z=3.0)
    after = mavros_feedforward.add_to_loop(before, ADDED, moved, 0)
    assert values(after.position) == pytest.approx([1.1, 2.2, 3.0])
    assert values(after.velocity) == pytest.approx([0.3, 0.4, 0.0])
    assert values(after.acceleration_or_force) == pytest.approx([5.0, 6.0, 0.0])
    without = mavros_feedforward.add_to_loop(
        set_point(IGNORE_POSITION | IGNORE_ACCELERATION), ADDED, moved, 0
    )
    np.testing.assert_allclose(values(without.acceleration_or_force), ADDED)
    assert values(without.velocity) == [0.4, 0.5, 0.6]


@pytest.mark.skipif(find_spec('mavros_msgs') is not None, reason='mavros_msgs is installed')
def test_without_mavros_msgs_it_says_what_to_do(ros_domain, capsys) -> None:
    assert mavros_feedforward.main([]) == 1
    assert 'mavros_msgs' in capsys.readouterr().err
