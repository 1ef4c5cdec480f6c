"""Every injected fault, at rest and in motion, and the bridge's reaction."""

import re
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.model.dynamics import Dynamics, largest_gravity_load

MOVING = [0.8, 0.0, 0.8, 0.8]

# Fault, board, motor, value; what the first text of the list of faults must say.
STOPPING = [
    ('dead_board', 0, 0, None, 'board0: .* consecutive frames were bad'),
    ('dead_board', 1, 0, None, 'board1: .* consecutive frames were bad'),
    ('bit_errors', 1, 0, 1.0, 'board1: .* consecutive frames were bad'),
    ('lost_frames', 0, 0, 1.0, 'board0: .* consecutive frames were bad'),
    ('encoder_jump', 0, 0, None, 'encoder of joint1 jumped by 3.1'),
    ('encoder_jump', 1, 1, -2.0, 'encoder of joint4 jumped by (2.0|1.9)'),
    ('over_temperature', 0, 0, None, r'board0: error 3 \(critical temperature\): let the board'),
    ('driver_error', 1, 0, None, r'board1: error 7 \(driver fault\): check the supply'),
    ('board_timeout', 1, 0, None, 'board1: 10 consecutive commands did not reach the board'),
    ('lost_commands', 0, 0, 0.8, 'board0: .* consecutive commands did not reach the board'),
    ('mute_board', 0, 0, None, 'board0: .* consecutive frames were bad'),
    ('short_answers', 1, 0, None, 'board1: .* consecutive frames were bad'),
    ('slow_bus', 0, 0, None, 'board0: exchanges take 2.00 ms'),
]


def run(rig, seconds, moving):
    rig.run(seconds, (lambda now: (None, MOVING, None)) if moving else None)


@pytest.mark.parametrize('moving', [False, True], ids=['at rest', 'in motion'])
@pytest.mark.parametrize(('fault', 'board', 'motor', 'value', 'text'), STOPPING)
def test_faults_that_stop_the_arm(rig, fault, board, motor, value, text, moving):
    run(rig, 0.2 if moving else 0.0, moving)
    rig.inject(fault, board, motor, value)
    run(rig, 0.1, moving)
    assert rig.bridge.mode == 'fault'
    assert re.search(text, rig.bridge.faults[0]), rig.bridge.faults
    first = rig.bridge.faults[0]
    run(rig, 0.3, moving)
    assert rig.bridge.faults[0] == first
    assert rig.speed < 0.05
    assert np.abs(rig.plant.position - rig.config.rest_position).max() < 1.0


@pytest.mark.parametrize(('board', 'motor', 'joint'), [(0, 0, 'joint1'), (1, 1, 'joint4')])
def test_a_stuck_encoder_in_motion_stops_the_arm(rig, board, motor, joint):
    run(rig, 0.2, moving=True)
    rig.inject('stuck_encoder', board, motor)
    run(rig, 0.2, moving=True)
    assert rig.bridge.mode == 'fault'
    assert f'{joint} does not move although its' in rig.bridge.faults[0]
    # Its motor gets no current at all: damping needs an encoder.
    number = rig.config.joint_names.index(joint)
    assert abs(rig.boards.boards[board].motors[motor].target_current) == 0.0
    assert rig.bridge.references.motors[number].kd == 0.0
    rig.run(0.4)
    assert rig.speed < 0.05


def test_a_stuck_encoder_at_rest_is_found_when_the_joint_shall_move(rig):
    rig.inject('stuck_encoder', 0, 0)
    rig.run(0.3)
    assert rig.bridge.mode == 'ready'
    run(rig, 0.3, moving=True)
    assert rig.bridge.mode == 'fault'
    assert 'joint1 does not move' in rig.bridge.faults[0]
    rig.run(0.4)
    assert rig.speed < 0.05


@pytest.mark.parametrize('fault', ['bit_errors', 'lost_frames'])
@pytest.mark.parametrize('moving', [False, True], ids=['at rest', 'in motion'])
def test_single_bad_frames_are_counted_and_the_arm_continues(rig, fault, moving):
    run(rig, 0.1, moving)
    rig.inject(fault, 1, value=0.1)
    run(rig, 1.0, moving)
    assert rig.bridge.mode == ('running' if moving else 'ready')
    bad = rig.bridge.counters['board1 bad frames']
    lost = rig.bridge.counters['board1 lost commands']
    assert 50 < bad < 200
    # Flipped bits damage each way for itself; what the board missed as a whole is counted once.
    assert 50 < lost < 250 if fault == 'bit_errors' else lost == 0
    assert rig.bridge.counters['board0 bad frames'] == 0
    if moving:
        assert rig.plant.velocity[2:] == pytest.approx(MOVING[2:], abs=0.1)


def test_the_last_good_state_stays_while_frames_are_bad(rig):
    run(rig, 0.2, moving=True)
    before = rig.bridge.q.copy()
    rig.inject('lost_frames', 1, value=1.0)
    rig.send(velocity=MOVING)
    rig.cycle()
    assert rig.bridge.q[2:].tolist() == before[2:].tolist()
    assert rig.bridge.q[0] != before[0]


def test_a_driven_arm_that_loses_its_zeros_is_stopped(rig):
    run(rig, 0.2, moving=True)
    # It seems to have restarted, and its motors are driven all the same.
    rig.boards.boards[0]._clock += 5.0
    run(rig, 0.01, moving=True)
    assert rig.bridge.mode == 'fault'
    assert 'board0 restarted while it was enabled' in rig.bridge.faults[0]
    assert rig.bridge.zeros.unknown == ['joint1', 'joint2']
    assert not rig.send(velocity=MOVING)
    assert 'disable it first' in rig.bridge.clear_fault().message


def test_a_board_error_is_cleared_by_a_power_cycle_and_a_new_alignment(rig):
    rig.inject('driver_error', 1)
    rig.run(0.05)
    answer = rig.bridge.clear_fault()
    assert not answer.accepted
    assert 'power-cycle' in answer.message
    rig.inject('power_cycle', 1)
    rig.run(0.05)
    # The restarted board stays off although the bridge was enabled: no move without a request.
    assert not rig.boards.boards[1].system_enabled
    assert rig.bridge.clear_fault().accepted
    rig.boards.carry()
    rig.run(0.05)
    assert rig.bridge.mode == 'unhomed'
    # Its encoders count from where they were switched on.
    assert 'the zero of joint3, joint4 is unknown' in rig.bridge.enable().message
    rig.boards.put_at_rest()
    rig.run(0.01)
    assert rig.bridge.home().accepted
    rig.run_until('ready', 3.5)
    assert rig.bridge.mode == 'ready', rig.bridge.faults
    assert rig.bridge.q == pytest.approx(rig.plant.position, abs=1e-3)


def test_a_board_of_the_other_kind_drops_its_error_when_disabled(config, make_rig):
    rig = make_rig(config=replace(config, profile='udriver_v2')).bring_up()
    rig.inject('driver_error', 1)
    rig.run(0.05)
    assert rig.bridge.mode == 'fault'
    assert 'error 7' in rig.bridge.faults[0]
    assert rig.boards.boards[1].error == 0  # the bridge has disabled it
    hint = rig.bridge.recovery_hint(emulated=False)
    assert 'switch the supply' not in hint
    assert hint.endswith("'arm clear_fault', 'arm enable'")
    assert rig.bridge.clear_fault().accepted
    rig.boards.carry()
    rig.bring_up()
    rig.run(0.5, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    assert rig.plant.velocity[0] == pytest.approx(0.5, abs=0.05)


def test_a_board_lost_while_off_is_not_a_fault_but_cannot_be_enabled(make_rig):
    rig = make_rig()
    rig.run(0.02)
    rig.inject('dead_board', 1)
    rig.run(0.05)
    assert rig.bridge.mode == 'disconnected'
    assert 'no answer from board1' in rig.bridge.faults[0]
    assert not rig.bridge.enable().accepted
    rig.inject('power_cycle', 1)
    rig.run(0.05)
    assert rig.bridge.mode == 'idle'


def test_a_slow_exchange_now_and_then_is_only_counted(rig):
    for _ in range(20):
        rig.inject('slow_bus', 1)
        rig.cycle()
        rig.inject('slow_bus', 1, value=50e-6)
        rig.run(0.005)
    assert rig.bridge.mode == 'ready'
    assert rig.bridge.counters['board1 slow exchanges'] == 20


@pytest.mark.parametrize('early', range(4))
def test_effort_that_steps_at_the_last_count_is_not_taken_for_feedback(
    make_rig, robot, early: int
) -> None:
    # Boards answer before they take a command, so a cycle's current is that of the one before.
    rig = make_rig(position=[0.3, 1.2, 0.0, 0.2])
    rig.bridge = BridgeCycle(rig.config, rig.boards, load_max=largest_gravity_load(robot))
    rig.bridge.zeros.found()
    rig.bring_up()
    load = Dynamics(robot).gravity(rig.bridge.q)
    rig.run(0.3, lambda now: (None, None, load))
    rig.inject('stuck_encoder', board=0, motor=1)  # the joint rests, as friction may hold it
    rig.run(0.053)
    assert rig.bridge.mode == 'damping'
    rig.inject('encoder_jump', board=0, motor=1, value=0.002)  # the last count
    rig.run(1e-3 * early)
    rig.run(0.2, lambda now: (None, None, load))
    assert rig.bridge.mode == 'running', rig.bridge.faults


def test_taking_over_a_resting_arm_is_not_taken_for_a_stuck_encoder(make_rig, robot) -> None:
    rig = make_rig(position=[0.3, 1.0, 0.0, 0.2])
    rig.bridge = BridgeCycle(rig.config, rig.boards, load_max=largest_gravity_load(robot))
    rig.bridge.zeros.found()
    rig.bring_up()  # held by the boards
    load = Dynamics(robot).gravity(rig.bridge.q)
    rig.inject('stuck_encoder', board=0, motor=1)  # the joint rests, as friction may hold it
    rig.run(0.3, lambda now: (None, None, load))
    assert rig.bridge.mode == 'running', rig.bridge.faults


def test_while_a_board_is_silent_the_others_go_on_damping(rig):
    rig.inject('dead_board', 1)
    rig.run(0.1)
    answer = rig.bridge.clear_fault()
    assert not answer.accepted
    assert 'no answer from board1: disable the arm first' in answer.message
    rig.run(0.1)
    assert rig.boards.boards[0].system_enabled
    rig.bridge.disable()
    assert rig.bridge.clear_fault().accepted
    rig.run(0.05)
    assert rig.bridge.mode == 'disconnected'
    assert not rig.boards.boards[0].system_enabled
