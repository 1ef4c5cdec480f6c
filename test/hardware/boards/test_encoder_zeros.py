import numpy as np
import pytest

from aerarm_ros.hardware.boards.encoder_zeros import EncoderZeros


@pytest.fixture
def zeros(config):
    return EncoderZeros(config)


def test_zeros_are_assumed_until_one_is_lost(zeros):
    assert not zeros.are_lost
    assert zeros.problem == ''
    zeros.lose([], 'nobody')
    assert not zeros.are_lost
    zeros.lose([3, 1], 'a jump')
    zeros.lose([1], 'another')
    assert zeros.are_lost
    assert zeros.problem == (
        'the zero of joint2, joint4 is unknown (a jump): bring the arm to its rest posture, '
        'joint1 0, joint2 1.571, joint3 0, joint4 0 rad, and home it'
    )
    zeros.lose([0], 'another')
    assert 'joint1, joint2, joint4 is unknown (a jump, another)' in zeros.problem
    zeros.found()
    assert not zeros.are_lost


def test_the_rest_posture_is_asked_for_once_the_zeros_are_known(zeros, config):
    turns = np.array([0.0, 0.32, -0.34, 0.0])
    away = zeros.rest + 2.0 * np.pi * turns
    assert zeros.refusal(away) == ''  # who homes the arm vouches for it
    zeros.found()
    assert zeros.refusal(away).startswith('joint3 is not at the rest posture, joint1 0, joint2')
    assert zeros.refusal(zeros.rest + 0.3 * 2.0 * np.pi) == ''
    zeros.lose([0], 'a jump')
    assert zeros.refusal(away) == ''
    assert zeros.rest[1] == pytest.approx(
        config.joints[1].sign * config.rest_position[1] / config.joints[1].gear.ratio
    )
    assert 'taken for the rest posture, joint1 0, joint2 1.571' in zeros.vouched()
