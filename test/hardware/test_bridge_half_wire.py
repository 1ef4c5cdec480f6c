"""A board that receives but is not received damps its joints until the user disables it."""

import numpy as np
import pytest
from attack_rig import AttackRig, Offer
from attack_world import WAKE

STRETCHED = [0.0, 0.3, 0.0, 0.2]


def spin(rig):
    return Offer(velocity=[1.0, 0.0, -1.0, 1.0])


def fling(rig):
    return Offer(velocity=[5.0, -1.0, 5.0, 5.0])


def push(rig):
    return Offer(velocity=[5.0, -1.0, np.nan, np.nan], effort=[np.nan, np.nan, 3.0, 3.0])


def sent_since(rig, board, time):
    """Return the commands to a board after a true time [s]."""
    late = rig.frames.times(board) > time
    return {name: values[late] for name, values in rig.frames.commands(board).items()}


def cut(rig, fault, board):
    """Break a wire of a board, and return the time."""
    rig.inject(fault, board)
    return rig.now


@pytest.mark.parametrize('fault', ['mute_board', 'short_answers'])
@pytest.mark.parametrize('source', [None, spin], ids=['held', 'moving'])
@pytest.mark.parametrize(
    ('board', 'posture', 'payload', 'seed'),
    [(0, STRETCHED, 0.3, None), (1, [0.5, 1.0, 0.4, -0.6], 0.0, 4), (0, None, 0.1, 7)],
)
def test_a_board_without_answers_receives_damping_and_the_arm_does_not_fall(
    config, robot, fault, source, board, posture, payload, seed
):
    rig = AttackRig(config, robot, posture=posture, payload=payload, seed=seed).bring_up()
    rig.run(0.1, source)
    at = cut(rig, fault, board)
    log = rig.run(0.4, source)
    assert rig.bridge.mode == 'fault'
    for number in (0, 1):
        told = sent_since(rig, number, at)
        assert told['enable_system'].all()
        assert told['enable_motor'].all()
        # Damped from the tenth bad frame on.
        assert not told['kp'][-380:].any()
        assert not told['current'][-380:].any()
        assert told['kd'][-380:].all()
        assert (told['timeout'] > 0.0).all()
    # Without motors joint 2 reaches 7.5 rad/s; damped it sinks.
    assert np.abs(log.dq[-380:, 1]).max() < 1.0
    assert np.abs(log.dq[-100:]).max() < 1.0
    assert [board.system_enabled for board in rig.boards.boards] == [True, True]
    texts = ' '.join(rig.bridge.faults)
    assert f'board{board}: 10 consecutive frames were bad' in texts
    assert f'board{board} sends no valid frames' in texts


@pytest.mark.parametrize('source', [fling, push], ids=['velocity', 'effort'])
@pytest.mark.parametrize('board', [0, 1])
def test_at_full_speed_a_board_without_answers_is_not_driven_and_the_other_keeps_its_limits(
    config, robot, source, board
):
    # Its last speed says nothing any more: a barrier that led the joint on by it would drive it.
    rig = AttackRig(config, robot, posture=[-0.6, -0.2, 0.3, 0.0], payload=0.2, seed=4).bring_up()
    rig.run(0.25, source)
    assert np.abs(rig.log.dq[-1]).max() > 2.5
    at = cut(rig, 'mute_board', board)
    log = rig.run(0.9, source)
    assert rig.bridge.mode == 'fault'
    late = sent_since(rig, board, at + 0.012)
    assert late['enable_system'].all()
    assert not late['velocity'].any()
    assert not late['current'].any()
    assert not late['kp'].any()
    assert np.abs(log.dq[-600:, 2 * board : 2 * board + 2]).max() < 1.0
    heard = [joint.board != board for joint in config.joints]
    assert log.beyond(config)[heard].max() < 0.02


def test_damping_continues_until_the_user_disables_the_arm(config, robot):
    rig = AttackRig(config, robot, posture=STRETCHED).bring_up()
    cut(rig, 'mute_board', 0)
    rig.run(0.05)
    answer = rig.bridge.clear_fault()
    assert 'no answer from board0: disable the arm first' in answer.message
    rig.run(0.05)
    assert rig.boards.boards[0].system_enabled
    rig.bridge.disable()
    at = rig.now
    rig.run(0.05)
    assert not rig.boards.boards[0].system_enabled
    assert not sent_since(rig, 0, at)['enable_system'].any()
    assert 'no answer from board0' in ' '.join(rig.bridge.faults)
    assert rig.bridge.clear_fault().accepted
    rig.run(0.02)
    assert rig.bridge.mode == 'disconnected'
    assert 'no answer from board0' in rig.bridge.enable().message


def test_a_wire_that_is_whole_again_needs_no_new_alignment(config, robot):
    rig = AttackRig(config, robot, posture=STRETCHED, seed=3).bring_up()
    cut(rig, 'mute_board', 0)
    rig.run(0.3)
    rig.boards.boards[0].faults.mute = False
    rig.run(0.02)
    assert rig.bridge.clear_fault().accepted
    rig.run(0.05)
    assert rig.bridge.mode == 'ready'
    rig.run(0.4)
    q = rig.plant.position
    rig.run(0.1)
    assert rig.plant.position == pytest.approx(q, abs=0.01)


def test_when_the_other_wire_breaks_too_its_own_time_out_is_there(config, robot):
    rig = AttackRig(config, robot, posture=STRETCHED, seed=5).bring_up()
    cut(rig, 'mute_board', 0)
    rig.run(0.1)
    rig.boards.boards[0].faults.deaf = True
    rig.run(0.1)
    assert not rig.boards.boards[0].system_enabled
    assert rig.boards.boards[0].error == 2
    # It is heard again: a board that has lost its alignment is told to stay off.
    rig.boards.boards[0].power_cycle()
    at = rig.now
    rig.run(0.1)
    told = sent_since(rig, 0, at)['enable_system']
    assert told[:2].any()  # its first answer comes with the frame that may have found it driving
    assert not told[2:].any()
    assert not rig.boards.boards[0].system_enabled
    assert np.abs(rig.plant.velocity[0]) < 0.05  # joint 1 was not aligned


def before_an_emergency_stop(rig):
    rig.bridge.e_stop('of the test')


def before_homing(rig):
    assert rig.bridge.home().accepted


def before_a_cleared_fault(rig):
    rig.bridge.e_stop('of the test')
    rig.run(0.03)
    assert rig.bridge.clear_fault().accepted


def between_controllers(rig):
    rig.run(0.02, spin)
    rig.run(0.08)
    assert rig.bridge.mode == 'damping'


@pytest.mark.parametrize(
    'prepare',
    [before_an_emergency_stop, before_homing, before_a_cleared_fault, between_controllers],
)
@pytest.mark.parametrize('fault', ['mute_board', 'short_answers'])
def test_in_every_mode(config, robot, prepare, fault):
    # A homed arm is homed again only from its home configuration.
    posture = None if prepare is before_homing else STRETCHED
    rig = AttackRig(config, robot, posture=posture, payload=0.1, seed=11).bring_up()
    prepare(rig)
    at = cut(rig, fault, 0)
    log = rig.run(0.3)
    assert rig.bridge.mode == 'fault'
    assert all(sent_since(rig, number, at)['enable_system'].all() for number in (0, 1))
    assert np.abs(log.dq[-290:]).max() < 1.0


def test_a_loose_contact(config, robot):
    """A wire fails and recovers, faster than it counts as broken, and then more slowly."""
    rig = AttackRig(config, robot, posture=STRETCHED, seed=12).bring_up()
    faults = rig.boards.boards[0].faults
    for broken, whole in [(9, 1)] * 15 + [(25, 5)] * 5:
        faults.mute = True
        rig.run(1e-3 * broken)
        faults.mute = False
        rig.run(1e-3 * whole)
        if broken == 9:
            assert rig.bridge.mode == 'ready'
    assert rig.bridge.mode == 'fault'
    told = rig.frames.commands(0)['enable_system']
    assert told[np.argmax(told) :].all()
    assert np.abs(rig.log.dq).max() < 1.0


def test_references_that_no_frame_can_represent_do_not_drop_the_arm(config, robot):
    rig = AttackRig(config, robot, posture=STRETCHED, seed=13).bring_up()
    motor = rig.bridge.references.motors[1]
    at = rig.now
    motor.set_zero(1e6)  # the board's count is far from where it says
    log = rig.run(0.2, lambda rig: Offer(velocity=[0.0] * 4))
    assert rig.bridge.mode == 'fault'
    assert 'outside the range' in rig.bridge.faults[0]
    assert sent_since(rig, 0, at)['enable_system'].all()
    assert sent_since(rig, 0, at)['enable_motor'].all()
    assert np.abs(log.dq).max() < 1.0


def test_a_board_that_timed_out_during_a_pause_is_commanded_to_stay_off(config, robot):
    # Its time-out passes in a pause of the host: who hears it next may not be aligned again.
    pause = {'at': -1}
    rig = AttackRig(
        config,
        robot,
        posture=STRETCHED,
        delays=lambda cycle, point: 0.06 if (cycle, point) == (pause['at'], WAKE) else 0.0,
    ).bring_up()
    cut(rig, 'mute_board', 0)
    rig.run(0.05)
    pause['at'] = rig.cycles + 1
    rig.run(0.1)
    late = rig.now
    rig.run(0.1)
    assert not sent_since(rig, 0, late)['enable_system'].any()
