import numpy as np
import pytest

from aerarm_ros.hardware.emulation.emulated_transport import parse_turn
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')


def turn(boards, joint, angle):
    begin = boards.plant.time
    duration = boards.turn(joint, angle)
    boards.advance(0.0)
    for cycle in range(round(1e3 * duration) + 20):
        boards.advance(1e-3 * cycle)
    return boards.plant.time - begin


def test_the_hand_turns_one_joint_and_releases_it(config, robot):
    boards = make_emulated_transport(config, robot, 3)
    for joint, angle in enumerate([1.5, 3.1, -1.5, 1.5]):
        before = boards.plant.position
        turn(boards, joint, angle)
        moved = boards.plant.position - before
        assert boards.plant.position[joint] == pytest.approx(angle, abs=0.015)
        assert np.abs(boards.plant.velocity).max() < 1e-3
        others = np.arange(4) != joint
        # The joint pulls at the others, whose friction holds them.
        assert np.abs(moved[others]).max() < 0.01
        turn(boards, joint, before[joint])
        assert boards.plant.position == pytest.approx(before, abs=0.02)


def test_the_hand_refuses_driven_motors_and_angles_beyond_a_limit(config, robot, rig):
    with pytest.raises(ValueError, match='disable the arm first'):
        rig.boards.turn(0, 1.0)
    boards = make_emulated_transport(config, robot, None)
    with pytest.raises(ValueError, match='joint4 can turn from'):
        boards.turn(3, 3.0)


def test_joint_and_angle_are_read():
    assert parse_turn('joint2: -0.5', NAMES) == (1, -0.5)
    assert parse_turn('joint2:1', ['left_joint1', 'left_joint2']) == (1, 1.0)


@pytest.mark.parametrize('text', ['joint2', ':1', 'joint5:1', 'joint:1', 'joint1:nan', 'joint1:x'])
def test_an_invalid_turn_is_rejected(text):
    with pytest.raises(ValueError, match='must be JOINT:ANGLE'):
        parse_turn(text, NAMES)
