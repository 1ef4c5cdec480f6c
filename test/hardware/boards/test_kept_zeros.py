"""Zeros that survive a restart of the bridge, with boards that stayed on or were restarted."""

import json
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.boards.homing import EncoderZeros
from aerarm_ros.hardware.boards.kept_zeros import (
    AWAY_MAX,
    HostClock,
    KeptJoint,
    KeptZeros,
    KeptZerosError,
    ZeroRecall,
    arm_identity,
    sealed,
)
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.frames.board_messages import TIMESTAMP_PERIOD

HOST = HostClock('boot', 3.0)
TURN = 2.0 * np.pi
LEANING = [0.3, 1.1, -0.4, 0.5]


def kept_by(rig):
    """Return the bridge's stored zeros, through their text."""
    arm = arm_identity(rig.config)
    kept = replace(rig.bridge.recall.keep(arm, HOST), heat=rig.bridge.heat.keep(rig.now))
    assert KeptZeros.parse(kept.text()) == kept
    return kept.check(arm, HOST, rig.now)


def homed_elsewhere(make_rig, **options):
    """Return an arm whose boards were switched on at rest, with a bridge that has its zeros."""
    config = load_arm_config()
    ratios = config.column('sign') * config.column('gear.ratio')
    at = (np.array(config.rest_position) - config.column('offset')) / ratios
    rig = make_rig(position=LEANING, encoder_zeros=list(at), **options)
    rig.bridge.zeros.found()
    rig.bridge._set_zero(-at)  # what homing would have found
    rig.run(0.02)
    for board in rig.boards.boards:
        for motor in board.motors:
            motor.encoder.index_detected = True
    rig.run(0.02)
    assert rig.bridge.mode == 'idle'
    np.testing.assert_allclose(rig.bridge.q, LEANING, atol=1e-3)
    return rig


def away(rig, seconds):
    """Let time pass without a bridge, for boards of an arm that rests."""
    rig.now += seconds
    rig.boards._now = rig.now
    for board in rig.boards.boards:
        board._clock += seconds
        board.prepare()


def restarted(rig, kept):
    """Return the rig with another bridge that has found its boards."""
    rig.bridge = BridgeCycle(rig.config, rig.boards, robot=rig.robot, kept=kept)
    rig.run(0.02)
    return rig.bridge


def test_zeros_survive_a_bridge_restart_if_the_boards_stay_on(make_rig):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    away(rig, 3.0)
    bridge = restarted(rig, kept)
    assert bridge.mode == 'idle'
    np.testing.assert_allclose(bridge.q, rig.plant.position, atol=1e-3)
    assert [motor.zero for motor in bridge.references.motors] == bridge.references.zero.tolist()
    assert bridge.enable().accepted
    # A board that keeps errors lost one only with its supply.
    wrong = replace(kept, boards=tuple(replace(board, error=3) for board in kept.boards))
    assert 'board1 was switched off and on' in restarted(rig, wrong).zeros.problem


def test_without_a_file_it_does_not(make_rig):
    rig = homed_elsewhere(make_rig)
    away(rig, 1.0)
    bridge = restarted(rig, None)
    assert bridge.mode == 'unhomed'
    assert all(link.state.index_detected == [True, True] for link in bridge.links)
    assert "then run 'arm home'" in bridge.enable().message


@pytest.mark.parametrize('board', [0, 1])
def test_a_board_that_was_switched_off_and_on_has_lost_its_zeros_alone(make_rig, board):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    away(rig, 1.0)
    rig.inject('power_cycle', board)
    away(rig, 1.0)
    bridge = restarted(rig, kept)
    assert bridge.mode == 'unhomed'
    assert bridge.zeros.unknown == [['joint1', 'joint2'], ['joint3', 'joint4']][board]
    reason = f'board{board} was switched off and on while the bridge was not running'
    assert reason in bridge.zeros.problem
    assert [text.count(reason) for text in bridge.faults] == [1]


def coincident(rig, board):
    """Cycle a board's supply so that its clock appears uninterrupted, a rare coincidence."""
    board = rig.boards.boards[board]
    clock = board._clock
    board.power_cycle()
    board._clock = clock


def test_a_clock_that_fits_by_chance_is_not_enough(make_rig):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    coincident(rig, 0)
    bridge = restarted(rig, kept)  # the pulses that were met are forgotten
    assert bridge.zeros.unknown == ['joint1', 'joint2']
    for motor in rig.boards.boards[0].motors:
        motor.encoder.index_detected = True  # ... were met again
    bridge = restarted(rig, kept)
    assert bridge.zeros.unknown == ['joint1', 'joint2']
    assert 'board0 has another encoder count of joint' in bridge.zeros.problem


def test_an_index_bit_that_flipped_without_a_pulse_between_is_another_count(make_rig):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    encoder = rig.boards.boards[1].motors[0].encoder
    encoder.index_toggle = not encoder.index_toggle
    assert restarted(rig, kept).zeros.unknown == ['joint3', 'joint4']


def test_a_pulse_that_was_measured_again_is_homed_by(make_rig):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    offsets = np.array([0.0, 0.0, 0.0, 0.3])
    again = BridgeCycle(rig.config, rig.boards, robot=rig.robot, kept=kept, pulse_offset=offsets)
    rig.bridge = again
    rig.run(0.02)
    assert again.zeros.unknown == ['joint3', 'joint4']
    assert 'board1 was homed with another index pulse of joint4' in again.zeros.problem


def test_a_clock_of_16_bits_is_read_across_its_wrap_and_not_beyond_its_period(make_rig):
    rig = homed_elsewhere(make_rig)
    for board in rig.boards.boards:
        board._clock = TIMESTAMP_PERIOD - 1.0
    restarted(rig, None).zeros.found()
    rig.bridge._set_zero(rig.bridge.state.reported_position - rig.bridge.zeros.rest)
    rig.run(0.01)
    kept = kept_by(rig)
    away(rig, 3.0)
    assert restarted(rig, kept).mode == 'idle'
    # One period later the clock reads the same.
    rig.now += TIMESTAMP_PERIOD
    rig.boards._now = rig.now
    bridge = restarted(rig, kept)
    assert bridge.mode == 'unhomed'
    assert f'its clock can show a restart only within {AWAY_MAX:g} s' in bridge.zeros.problem


@pytest.mark.parametrize('drift', [4e-4, -4e-4, 3e-2, -3e-2])
def test_a_clock_may_drift_as_crystals_do(make_rig, drift):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    away(rig, 2.0)
    for board in rig.boards.boards:
        board._clock += 2.0 * drift
    assert restarted(rig, kept).mode == ('idle' if abs(drift) < 1e-3 else 'unhomed')


def test_the_angles_of_an_arm_that_sank_during_a_bridge_restart_are_known(make_rig):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    rig.boards.is_carried = False
    for _ in range(150):
        rig.now += 0.01
        rig.boards.advance(rig.now)
    assert abs(rig.plant.position[1] - LEANING[1]) > 1.0
    bridge = restarted(rig, kept)
    assert bridge.mode == 'idle', bridge.faults
    np.testing.assert_allclose(bridge.q, rig.plant.position, atol=2e-3)


def test_zeros_that_are_not_known_are_not_kept(make_rig):
    rig = homed_elsewhere(make_rig)
    rig.bridge.zeros.lose([1, 2], 'a jump')
    names = [[joint.name for joint in board.joints] for board in kept_by(rig).boards]
    assert names == [['joint1'], ['joint4']]
    bridge = restarted(rig, kept_by(rig))
    assert bridge.zeros.unknown == ['joint2', 'joint3']


def test_those_that_wait_for_a_board_are_not_replaced(make_rig):
    rig = homed_elsewhere(make_rig)
    kept = kept_by(rig)
    rig.inject('lost_frames', 1, value=1.0)
    bridge = restarted(rig, kept)
    assert bridge.recall.keep('', HOST) is None
    assert bridge.zeros.unknown == ['joint3', 'joint4']
    rig.inject('lost_frames', 1, value=0.0)
    rig.run(0.05)
    assert bridge.mode == 'idle'
    assert bridge.recall.keep('', HOST) is not None


def test_a_board_with_absolute_encoders_needs_no_record(make_rig, config):
    rig = make_rig(config=config.with_encoders('absolute'), homed=False, position=LEANING)
    rig.run(0.02)
    assert rig.bridge.mode == 'idle'
    np.testing.assert_allclose(rig.bridge.q, LEANING, atol=1e-3)
    assert rig.bridge.recall.keep('', HOST).boards == ()


def test_a_file_of_another_arm_host_or_time_is_named(make_rig, config):
    rig = homed_elsewhere(make_rig)
    kept, arm = kept_by(rig), arm_identity(config)
    other = 'belongs to another arm, or to another configuration of its drives'
    for wrong, reason in [
        ((arm_identity(config.with_prefix('left_')), HOST, rig.now), other),
        ((arm_identity(config.with_encoders('absolute')), HOST, rig.now), other),
        ((arm, HostClock('other', 3.0), rig.now), 'was written before the host was started'),
        ((arm, HostClock('boot', 9.0), rig.now), 'was written before the host was suspended'),
        ((arm, HOST, rig.now - 1.0), 'has a time in the future'),
    ]:
        with pytest.raises(KeptZerosError, match=f'^the file {reason}$'):
            kept.check(*wrong)
    # The temperatures have a time of their own.
    with pytest.raises(KeptZerosError, match='future'):
        replace(kept, heat=replace(kept.heat, time=rig.now + 1.0)).check(arm, HOST, rig.now)


def test_a_file_that_is_not_whole_gives_no_zeros(make_rig):
    text = kept_by(homed_elsewhere(make_rig)).text()
    document = json.loads(json.loads(text)['kept'])
    wrong = [text[:cut] for cut in (0, 1, len(text) // 2, len(text) - 1)]
    for value in (None, 'NaN', True, [], 1e400):
        document['boards'][0]['joints'][0]['zero'] = value
        wrong.append(sealed(json.dumps(document)))
    wrong += [
        '[]',
        '{"kept": 3}',
        sealed('[]'),
        sealed('{"boards": 3}'),
        '[' * 100_000,
        text + ' ' * 100_000,
    ]
    for broken in wrong:
        with pytest.raises(KeptZerosError, match='^the file is incomplete or was written by'):
            KeptZeros.parse(broken)


# Motor angles [rad] of joint 4 with its zero at 1, pulses at 0.5 and whole turns from there; its
# limits with the mechanical stops are -2.444 and 2.444 rad, at motor angles 74.1 and -57.9.
@pytest.mark.parametrize(
    ('before', 'after', 'toggles', 'away', 'is_possible'),
    [
        (10.0, 10.0, [False], 0.0, True),
        (10.0, 10.0, [True], 0.0, False),
        (10.0, 14.0, [True], 0.02, True),  # past a pulse
        (10.0, 14.0, [False], 0.02, False),
        (10.0, 14.0, [True], 0.005, False),  # too far for the time
        (10.0, 10.0 + 2.0 * TURN, [False], 1.0, True),
        (10.0, 10.0 + 3.0 * TURN, [True], 1.0, True),
        (-10.0, -10.0 + 3.0 * TURN, [True], 1.0, True),
        (0.54 + 2.0 * TURN, 10.0, [True, False], 1.0, True),  # near a pulse either may be
        (10.0, 0.46 - TURN, [True, False], 1.0, True),
        (10.0, 0.56 - TURN, [True, False], 1.0, None),
        (70.0, 72.9, [False], 1.0, True),
        (70.0, 75.6, [False], 1.0, False),  # beyond the stops
        (-54.0, -56.7, [True], 1.0, True),
        (-54.0, -59.4, [True], 1.0, False),
    ],
)
def test_which_counts_a_motion_without_power_can_explain(
    config, before, after, toggles, away, is_possible
):
    joint = replace(config.joints[3], sign=-1, offset=0.3)
    config = replace(config, joints=(*config.joints[:3], joint))
    recall = ZeroRecall(config, EncoderZeros(config), (), np.zeros(4))
    kept = KeptJoint('joint4', 1.0, 1.0 + before, 0.5, True, False)
    found = {recall._can_have_moved(3, kept, 1.0 + after, toggled, away) for toggled in toggles}
    assert found == ({is_possible} if is_possible is not None else {True, False})


def test_new_index_pulses_lose_the_zeros_that_were_found_with_others(config):
    mixed = replace(
        config, boards=(replace(config.boards[0], encoders='absolute'), config.boards[1])
    )
    zeros = EncoderZeros(mixed)
    zeros.found()
    recall = ZeroRecall(mixed, zeros, (), np.zeros(4), pulse_offset=0.5)
    assert recall.take_pulse_offset(0.5, False) == ''
    assert recall.take_pulse_offset([0.5, 0.7, 0.5, 0.5], False) == (
        'the motors are on: the bridge uses the new index pulses after its next restart'
    )
    assert recall.pulse_offset.tolist() == [0.5] * 4
    assert recall.take_pulse_offset([0.5, 0.7, 0.5, 0.9], True) == ''
    assert recall.pulse_offset.tolist() == [0.5, 0.7, 0.5, 0.9]
    assert zeros.unknown == ['joint4']  # an absolute encoder keeps its zero
    assert 'joint4 is unknown (commissioned since it was homed)' in zeros.problem
    zeros.found()
    assert recall.take_pulse_offset(0.9, True) == ''
    assert zeros.unknown == ['joint3']
