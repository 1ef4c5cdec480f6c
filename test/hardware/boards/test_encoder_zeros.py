from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.hardware.boards.homing import EncoderZeros


@pytest.fixture
def zeros(config):
    return EncoderZeros(config)


def test_incremental_zeros_are_unknown_until_they_are_found(zeros):
    assert zeros.unknown == ['joint1', 'joint2', 'joint3', 'joint4']
    assert zeros.problem == (
        'the zero of joint1, joint2, joint3, joint4 is unknown (not homed since the bridge '
        'started): bring the arm to its home configuration, joint1 0, joint2 1.571, joint3 0, '
        "joint4 0 rad, then run 'arm home'"
    )
    q = np.array([1.0, 2.0, 3.0, 4.0])
    assert np.isnan(zeros.known_only(q)).all()
    assert q.tolist() == [1.0, 2.0, 3.0, 4.0]
    zeros.found()
    assert zeros.known_only(q) is q
    zeros.restarted([1], 'board0 was switched off and on')
    assert zeros.unknown == ['joint2']
    assert zeros.known_only(q).tolist() == pytest.approx([1.0, np.nan, 3.0, 4.0], nan_ok=True)


def test_an_absolute_encoder_knows_its_angle_whenever_its_board_is_switched_on(config):
    boards = (replace(config.boards[0], encoders='absolute'), config.boards[1])
    zeros = EncoderZeros(replace(config, boards=boards))
    assert zeros.unknown == ['joint3', 'joint4']
    assert zeros.expected(np.full(4, 9.0)).tolist() == [9.0, 9.0, *zeros.rest[2:]]
    zeros.found()
    zeros.restarted(range(4), 'a power cycle')
    assert zeros.unknown == ['joint3', 'joint4']
    zeros.lose([0], 'a jump')
    assert zeros.unknown == ['joint1', 'joint3', 'joint4']
    zeros.restarted([0], 'a power cycle')
    assert zeros.unknown == ['joint3', 'joint4']
    assert not EncoderZeros(config, 'absolute').are_lost


def test_zeros_that_are_lost_are_named_with_their_reasons(zeros):
    zeros.found()
    assert not zeros.are_lost
    assert zeros.problem == ''
    zeros.lose([], 'nobody')
    assert not zeros.are_lost
    zeros.lose([3, 1], 'a jump')
    zeros.lose([1], 'another')
    assert zeros.are_lost
    assert zeros.problem == (
        'the zero of joint2, joint4 is unknown (a jump): bring the arm to its home '
        "configuration, joint1 0, joint2 1.571, joint3 0, joint4 0 rad, then run 'arm home'"
    )
    zeros.lose([0], 'another')
    assert 'joint1, joint2, joint4 is unknown (a jump, another)' in zeros.problem
    zeros.found()
    assert not zeros.are_lost


def test_homing_requires_the_home_configuration_if_the_zeros_are_known(zeros, config):
    turns = np.array([0.0, 0.32, -0.34, 0.0])
    away = zeros.rest + 2.0 * np.pi * turns
    assert zeros.refusal(away) == ''  # who homes the arm vouches for it
    zeros.found()
    assert zeros.refusal(away).startswith(
        'joint3 is not at the home configuration, joint1 0, joint2'
    )
    assert zeros.refusal(zeros.rest + 0.3 * 2.0 * np.pi) == ''
    # A joint whose zero is unknown vouches for no other.
    zeros.lose([0], 'a jump')
    assert zeros.refusal(away).startswith('joint3 is not at the home configuration')
    zeros.lose([2], 'a jump')
    assert zeros.refusal(away) == ''
    assert zeros.rest[1] == pytest.approx(
        config.joints[1].sign * config.rest_position[1] / config.joints[1].gear.ratio
    )
    assert (
        'homing assumes that the arm is at its home configuration, joint1 0, joint2 1.571'
    ) in zeros.assumed_home()
