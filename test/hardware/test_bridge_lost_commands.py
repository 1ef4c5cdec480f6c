"""Commands that a board does not receive (MOSI) while its answers arrive."""

import pytest
from attack_campaign import SPEED_MAX, run
from attack_rig import AttackRig

STRETCHED = [0.0, 0.3, 0.0, 0.2]
CHECK = 'check the MOSI wire, its connector, the ground wire and clock_hz'


# Before, in this order: 1.29, 1.32, 1.5, 1.2 and 1.33 of the speed limit.
@pytest.mark.parametrize(
    ('attack', 'number', 'rate'),
    [
        ('velocity', 0, 0.7),
        ('alternating', 1, 0.7),
        ('any_mode', 2, 1.0),
        ('violation', 1, 1.0),
        ('stopping', 2, 1.0),
    ],
)
def test_no_joint_is_too_fast_while_its_board_drives_it(attack, number, rate):
    outcome = run(attack, number, seconds=0.3, lost_commands=rate)
    assert outcome.speed <= SPEED_MAX, outcome
    assert outcome.names_the_wire, outcome


def test_a_board_whose_last_command_is_zero_current_releases_its_joints_after_the_time_out():
    # Its arm falls, at 1.23 times the limit 0.2 s later, without an error.
    outcome = run('effort_chatter', 3, seconds=0.3, lost_commands=1.0)
    assert outcome.speed <= SPEED_MAX, outcome


@pytest.mark.parametrize('board', [0, 1])
def test_a_wire_that_loses_some_commands_is_a_warning(config, robot, board):
    rig = AttackRig(config, robot, posture=STRETCHED).bring_up()
    rig.inject('lost_commands', board, 0, 0.2)
    rig.run(0.3)
    assert rig.bridge.mode == 'ready'
    (text,) = rig.bridge.faults
    assert text.startswith(f'board{board}: ')
    assert text.endswith(
        '% of the commands do not reach the board over MOSI, although its answers reach '
        f'the host; {CHECK}'
    )
    assert 40 < rig.bridge.counters[f'board{board} lost commands'] < 80
    assert rig.bridge.counters[f'board{1 - board} lost commands'] == 0


def test_a_wire_that_loses_many_in_a_row_stops_the_arm_and_is_named(config, robot):
    rig = AttackRig(config, robot, posture=STRETCHED).bring_up()
    rig.inject('lost_commands', 1, 0, 0.8)
    rig.run(0.3)
    assert rig.bridge.mode == 'fault'
    fault = (
        'board1: 10 consecutive commands did not reach the board over MOSI, although its '
        'answers reach the'
    )
    assert rig.bridge.gate.stop == f'{fault} host: {CHECK}'
    # Some commands arrive, so the board does not let go.
    assert all(board.system_enabled for board in rig.boards.boards)


def test_a_cut_wire_is_neither_enabled_nor_cleared(config, robot):
    rig = AttackRig(config, robot, posture=STRETCHED).bring_up()
    rig.inject('lost_commands', 0, 0, 1.0)
    rig.run(0.02)
    assert rig.bridge.mode == 'fault'
    answer = rig.bridge.clear_fault()
    assert not answer.accepted
    assert 'did not reach the board over MOSI' in answer.message
    other = AttackRig(config, robot, posture=STRETCHED)
    other.run(0.02)
    other.inject('lost_commands', 0, 0, 1.0)
    other.run(0.02)
    assert other.bridge.mode == 'idle'
    answer = other.bridge.enable()
    assert not answer.accepted
    assert 'did not reach the board over MOSI' in answer.message
