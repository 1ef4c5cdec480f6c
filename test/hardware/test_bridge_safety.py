"""Limits, stops and switching off, through the whole chain."""

import numpy as np
import pytest


@pytest.fixture
def near_limit(make_rig, config):
    """An arm whose last joint is a quarter radian from its upper limit."""
    return make_rig(position=[0.0, np.pi / 2, 0.0, config.joints[3].position_max - 0.25]).bring_up()


def test_limits_hold_the_arm_inside(near_limit):
    rig, highest = near_limit, near_limit.config.column('position_max')
    rig.run(1.0, lambda now: (None, [0.0, 0.0, 0.0, 1.2], None))
    assert rig.plant.position[3] < highest[3] + 0.01
    assert rig.plant.position[3] > highest[3] - 0.1
    assert rig.bridge.mode == 'running'
    assert rig.bridge.counters['limited soft_zone'] > 100
    assert any('near a position limit' in text for text in rig.bridge.faults)


def test_torque_control_into_a_limit_is_braked(near_limit):
    rig = near_limit
    nan = np.nan
    still, push = [0.0, 0.0, 0.0, nan], [nan, nan, nan, 0.4]
    rig.run(0.7, lambda now: (None, still, push))
    assert rig.plant.position[3] < rig.config.joints[3].position_max + 0.005
    assert rig.bridge.mode == 'running', rig.bridge.faults
    assert rig.bridge.counters['limited braking'] > 0


@pytest.mark.parametrize(
    ('command', 'hint'),
    [
        (([0.9, 1.5708, 0.0, 0.0], None, None), 'too far for one step'),
        ((None, [0.0, 0.0, 7.0, 0.0], None), 'velocity of 7.00'),
        ((None, None, [0.0, 0.0, 0.0, 30.0]), 'effort of 30.00'),
    ],
)
def test_a_violation_stops_the_arm_for_good(rig, command, hint):
    rig.run(0.3, lambda now: (None, [0.5, 0.0, 0.5, 0.5], None))
    rig.run(0.01, lambda now: command)
    assert rig.bridge.mode == 'fault'
    assert hint in rig.bridge.faults[0]
    rig.run(0.3, lambda now: (None, [0.5, 0.0, 0.5, 0.5], None))
    assert rig.bridge.mode == 'fault'
    assert rig.speed < 0.01
    assert rig.bridge.intake.rejections['not_ready'] > 200
    assert rig.bridge.clear_fault().accepted
    rig.run(0.2, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    assert rig.bridge.mode == 'running'
    assert rig.plant.velocity[0] > 0.3


def test_emergency_stop_is_latched_and_damped(rig):
    rig.run(0.3, lambda now: (None, [0.5, 0.0, 0.5, 0.5], None))
    rig.bridge.e_stop('the button')
    rig.run(0.3)
    assert rig.bridge.mode == 'fault'
    assert rig.bridge.faults[0] == 'emergency stop: the button'
    assert rig.speed < 0.01
    assert not rig.bridge.enable().accepted
    assert rig.bridge.clear_fault().accepted
    rig.run(0.1)
    assert rig.bridge.mode == 'ready'


def test_emergency_stop_ends_an_alignment(make_rig):
    rig = make_rig()
    rig.enable()
    rig.run(0.1)
    rig.bridge.e_stop('somebody shouted')
    rig.run(0.8)
    assert rig.bridge.mode == 'fault'
    assert not any(board.system_enabled for board in rig.boards.boards)
    assert rig.bridge.clear_fault().accepted
    rig.run(0.1)
    assert rig.bridge.mode == 'idle'


def test_shutdown_sends_zero_current_and_disabled_twice(rig):
    rig.run(0.1, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    counts = [link._command.index for link in rig.bridge.links]
    rig.bridge.shutdown()
    assert [link._command.index for link in rig.bridge.links] == [n + 2 for n in counts]
    assert rig.bridge.mode == 'idle'
    assert not any(board.system_enabled for board in rig.boards.boards)


def test_shutdown_survives_a_lost_frame(rig):
    answers = []
    board = rig.boards.boards[0]
    genuine = board.exchange

    def first_one_lost(frame):
        answers.append(frame)
        return bytes(34) if len(answers) == 1 else genuine(frame)

    board.exchange = first_one_lost
    rig.bridge.shutdown()
    assert not board.system_enabled


def test_boards_switch_off_by_themselves_after_the_bridge_has_ended(rig):
    rig.run(0.3, lambda now: (None, [0.5, 0.0, 0.5, 0.5], None))
    for _ in range(38):
        rig.now += 1e-3
        rig.boards.advance(rig.now)
    assert all(board.system_enabled for board in rig.boards.boards)
    for _ in range(5):
        rig.now += 1e-3
        rig.boards.advance(rig.now)
    assert not any(board.system_enabled for board in rig.boards.boards)
    assert {board.error for board in rig.boards.boards} == {2}
    assert not any(motor.target_current for board in rig.boards.boards for motor in board.motors)


def test_enabling_outside_the_limits_is_refused(make_rig):
    rig = make_rig(position=[0.0, 3.73, 0.0, 0.0])
    rig.run(0.02)
    answer = rig.bridge.enable()
    assert not answer.accepted
    assert 'outside their limits' in answer.message


def let_go(rig, speed):
    """Release an arm with a speed of joint 2 [rad/s], until the speed is measured."""
    rig.boards.is_carried = False
    rig.plant.support = 0.0
    rig.plant.reset(rig.plant.position, [0.0, speed, 0.0, 0.0])
    rig.run(0.01)


def any_driven(rig):
    return any(board.system_enabled for board in rig.boards.boards)


def test_a_falling_arm_is_not_enabled(make_rig):
    # Its rotors cannot be found: the alignment would fail, at more than the speed limit by then.
    rig = make_rig()
    rig.run(0.02)
    let_go(rig, 1.0)
    answer = rig.bridge.enable()
    assert not answer.accepted
    assert answer.message.startswith('joint2 moves at 1.0')
    assert answer.message.endswith('rad/s: hold the arm, wait until it rests, then enable it')
    rig.run(0.02)
    assert rig.bridge.mode == 'idle'
    assert not any_driven(rig)
    rig.boards.carry()
    rig.run(0.02)
    rig.bring_up()


def test_an_arm_released_during_alignment_is_stopped_and_switched_off(make_rig):
    rig = make_rig()
    rig.enable()
    let_go(rig, 5.2)
    assert rig.bridge.mode == 'fault'
    assert 'joint2 moves at' in rig.bridge.gate.stop
    assert 'while the motors align: support the arm, and enable again' in rig.bridge.gate.stop
    assert not any_driven(rig)
    assert rig.bridge.clear_fault().accepted
    rig.run(0.01)
    assert rig.bridge.mode == 'idle'
    assert 'joint2 moves at' in rig.bridge.enable().message


def test_enabling_waits_until_the_boards_are_off(rig):
    rig.bridge.disable()
    assert 'still switching their motors off' in rig.bridge.enable().message
    rig.run(0.01)
    assert rig.bridge.enable().accepted


def test_a_fault_that_would_come_back_at_once_is_not_cleared(rig):
    rig.bridge.e_stop('test')
    rig.run(0.05)
    # A damped arm sinks: let it have sunk below a limit, without hurry.
    rig.plant.support = 1.0
    posture = rig.plant.position
    for angle in np.linspace(posture[1], rig.config.joints[1].position_min - 0.08, 250):
        posture[1] = angle
        rig.plant.reset(posture)
        rig.cycle()
    answer = rig.bridge.clear_fault()
    assert not answer.accepted
    assert 'would stop the arm again at once, because joint2 is at' in answer.message
    assert rig.bridge.mode == 'fault'
    # The way out: off, back inside by hand, clear, enable.
    rig.bridge.disable()
    rig.run(0.05)
    assert rig.bridge.clear_fault().accepted
    rig.run(0.01)
    assert rig.bridge.mode == 'idle'
    assert 'outside their limits' in rig.bridge.enable().message
    rig.boards.put_back()
    rig.run(0.02)
    rig.bring_up()
