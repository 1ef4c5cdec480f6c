"""A delayed host: a pause below the boards' time-out switches no board off."""

import numpy as np
import pytest
from attack_rig import AttackRig, Offer
from attack_world import ANSWER, EXCHANGE, READ, WAKE
from held_up_host import MOTIONS, POINTS, run

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

TIME_OUT = BridgeSettings().board_timeout
STRETCHED = [0.0, 0.3, 0.0, 0.2]


def once(cycle, point, seconds):
    """Delay the host once."""
    return lambda at, where: seconds if (at, where) == (cycle, point) else 0.0


def is_driven(rig):
    """Return whether no board was switched off since it was first enabled."""
    for board in (0, 1):
        told = rig.frames.commands(board)['enable_system']
        if not told[np.argmax(told) :].all():
            return False
    return all(board.system_enabled for board in rig.boards.boards)


def spin(rig):
    return Offer(velocity=[2.0, 0.0, -3.0, 3.0])


def hold(rig):
    return None


def halt(rig):
    """Stop at once, by an emergency stop."""
    rig.bridge.e_stop('of the test')
    return Offer(velocity=[0.0] * 4)


@pytest.mark.parametrize('motion', MOTIONS)
def test_random_pauses_and_preemptions_cause_no_fault(motion):
    """Some 30 per second, of 1 to 15 ms, anywhere in a cycle; `make attacks` does thousands."""
    trial = run(motion, 1001)
    assert trial.delays > 15
    assert trial.is_clean, trial


@pytest.mark.parametrize('source', [hold, spin, halt])
@pytest.mark.parametrize(('posture', 'payload', 'seed'), [(STRETCHED, 0.0, None), (None, 0.3, 5)])
def test_a_pause_just_below_the_time_out_does_not_drop_the_arm(
    config, robot, source, posture, payload, seed
):
    pause = TIME_OUT - 2e-3
    rig = AttackRig(config, robot, posture=posture, payload=payload, seed=seed)
    rig.bring_up().run(0.1, source)
    # At each point in turn, with a few good cycles between.
    places = {rig.cycles + 8 * (1 + i): point for i, point in enumerate(POINTS)}
    rig.world.script(lambda cycle, point: pause if places.get(cycle) == point else 0.0)
    log = rig.run(0.45, source)
    assert is_driven(rig), log.faults
    assert not [fault for fault in log.faults if 'emergency' not in fault], log.faults
    # Held or damped, nothing falls: the same posture without motors reaches 4.5 rad/s.
    if source is not spin:
        assert np.abs(log.dq[-50:]).max() < 1.0


def test_a_latched_fault_and_pauses_longer_than_the_age_of_a_state(config, robot):
    """The bridge continues to damp the arm; earlier, 21 ms were enough to switch it off."""
    settings = BridgeSettings(board_timeout=0.255)
    rig = AttackRig(config, robot, posture=STRETCHED, settings=settings).bring_up()
    rig.bridge.e_stop('of the test')
    rig.world.script(lambda cycle, point: 0.2 if cycle % 20 == 19 and point == WAKE else 0.0)
    log = rig.run(0.7)
    assert is_driven(rig)
    assert np.abs(log.dq).max() < 1.0
    assert log.faults == ['emergency stop: of the test']


def test_a_pause_under_full_torque_keeps_the_guaranteed_speed(config, robot):
    """Earlier the speed was 1.3 times the limit after 5 ms, and 1.9 times after 10 ms."""
    push = Offer(velocity=[0.0, 0.0, 0.0, np.nan], effort=[np.nan] * 3 + [9.39])
    for cycle, pause in ((6, 0.015), (18, 0.015), (18, 0.005), (16, 0.036)):
        rig = AttackRig(config, robot, posture=[0.0, 1.57, 0.0, -1.5]).bring_up()
        rig.world.script(lambda at, where, c=cycle, p=pause: p * ((at, where) == (c, WAKE)))
        log = rig.run(0.08, lambda rig: push)
        assert 1.0 < log.speed_ratio(config)[3] < 1.15, (cycle, pause)
        assert log.faults == []


@pytest.mark.parametrize('point', [READ, f'{EXCHANGE} 1', f'{ANSWER} 1'])
@pytest.mark.parametrize('speed', [2.5, 4.5])
def test_a_preemption_between_clock_and_exchange_is_no_jump(config, robot, point, speed):
    rig = AttackRig(config, robot, posture=[0.0, 1.2, -1.0, -0.8], seed=2).bring_up()
    way = np.array([1.0, 0.0, 1.0, 1.0])
    places = {150: 2e-3, 170: 5e-3, 190: 15e-3}
    rig.world.script(lambda at, where: places.get(at, 0.0) if where == point else 0.0)
    log = rig.run(0.25, lambda rig: Offer(velocity=speed * way))
    assert np.abs(log.dq[-1]).max() > 0.8 * speed
    assert log.faults == []


@pytest.mark.parametrize('pause', [0.0, 4e-3, 12e-3])
@pytest.mark.parametrize(('fault', 'value'), [('encoder_jump', -0.6), ('encoder_jump', np.pi)])
def test_a_real_jump_is_found_at_once_on_a_quiet_host_and_after_a_pause(
    config, robot, pause, fault, value
):
    rig = AttackRig(config, robot, seed=3, delays=once(60, READ, pause)).bring_up()
    rig.run(0.08, spin)  # the pause is over
    rig.inject(fault, 1, 0, value)
    before = rig.cycles
    while not rig.bridge.gate.stop and rig.cycles < before + 20:
        rig.cycle(spin)
    assert 'encoder of joint3 jumped' in rig.bridge.gate.stop
    assert rig.cycles - before <= 2


def test_an_encoder_that_stands_still_is_found_as_soon_as_without_pauses(config, robot):
    found = []
    for delays in (None, lambda cycle, point: 2e-3 * (cycle % 7 == 0 and point == READ)):
        rig = AttackRig(config, robot, seed=3, delays=delays).bring_up()
        rig.run(0.1, spin)
        rig.inject('stuck_encoder', 1, 0)
        start = rig.now
        while not rig.bridge.gate.stop and rig.now < start + 0.5:
            rig.cycle(spin)
        assert 'joint3 does not move' in rig.bridge.gate.stop
        found.append(rig.now - start)
    assert found[1] < found[0] + 0.05


def test_a_joint_with_a_suspect_encoder_is_damped_until_the_second_reading(config, robot):
    """A single wrong reading stops the arm, but the joint stays damped."""
    rig = AttackRig(config, robot, seed=1).bring_up()
    rig.run(0.2, spin)
    encoder = rig.boards.boards[1].motors[1].encoder
    genuine = encoder._quantised
    encoder._quantised = lambda angle: genuine(angle) + 1.0
    rig.cycle(spin)
    encoder._quantised = genuine
    rig.run(0.3, spin)
    assert 'encoder of joint4 jumped' in rig.bridge.gate.stop
    kd = rig.frames.commands(1)['kd'][-300:, 1]
    assert (kd > 0.0).all()
    assert np.abs(rig.plant.velocity).max() < 0.1


@pytest.mark.parametrize('value', [1.0, -1.0])
def test_between_the_looks_no_board_is_driven_by_the_speed_of_a_jump(config, robot, value):
    def creep(rig):
        return Offer(velocity=[0.0, 0.0, 0.0, 0.5])

    rig = AttackRig(config, robot, seed=1).bring_up()
    rig.run(0.2, creep)
    rig.inject('encoder_jump', 1, 1, value)
    at = rig.now
    rig.run(0.02, creep)
    sent = rig.frames.commands(1)
    after = sent['kd'][rig.frames.times(1) > at, 1]
    cap = sent['current_saturation'][rig.frames.times(1) > at, 1]
    # The frame that meets the jump, one with as much damping as the speed before asks for, none.
    assert (after[:2] > 0.0).all()
    assert cap[1] < 0.5 * cap[0]
    assert not after[2:].any()


def test_a_pause_right_after_the_speed_turned_round(config, robot):
    rig = AttackRig(config, robot, posture=[0.0, 1.2, 0.0, -0.6], payload=0.2, seed=6)
    rig.bring_up()
    rig.world.script(once(200, f'{ANSWER} 1', 15e-3))
    way = np.array([1.0, 0.0, 1.0, 1.0])
    log = rig.run(0.3, lambda rig: Offer(velocity=(3.5 if rig.cycles < 200 else -3.5) * way))
    assert log.faults == []
    assert np.abs(log.speed_ratio(config)).max() < 1.15


def test_a_storm_of_pauses(config, robot):
    """Every second cycle is late, each by another time."""
    late = np.random.default_rng(3).uniform(1e-3, 15e-3, 1000)
    rig = AttackRig(config, robot, posture=[0.0, 1.4, 0.0, 0.0], seed=7).bring_up()
    rig.world.script(lambda at, where: late[at] if at % 2 and where == POINTS[at % 6] else 0.0)
    log = rig.run(0.6, lambda rig: Offer(velocity=1.5 * np.sin(4.0 * rig.now + np.arange(4))))
    assert log.faults == []
    assert is_driven(rig)


def test_occasional_slow_exchanges_of_one_board_cause_no_fault(config, robot):
    slow = f'{EXCHANGE} 0'
    rig = AttackRig(config, robot, posture=STRETCHED, seed=8).bring_up()
    rig.world.script(lambda at, where: 15e-3 if at % 12 == 0 and where == slow else 0.0)
    log = rig.run(0.4, lambda rig: Offer(velocity=[1.0, 0.0, 2.0, -2.0]))
    assert log.faults == []
    assert is_driven(rig)
    assert rig.bridge.counters['board0 slow exchanges'] > 10


def test_pauses_while_the_motors_align_and_when_they_are_ready(config, robot):
    rig = AttackRig(config, robot, seed=9)
    rig.run(0.02)
    assert rig.bridge.enable().accepted
    rig.world.script(lambda at, where: (TIME_OUT - 2e-3) * (at % 5 == 4 and where == WAKE))
    log = rig.run(1.3)
    assert rig.bridge.mode == 'ready', log.faults
    assert is_driven(rig)


def test_pauses_about_a_cleared_fault(config, robot):
    for point in POINTS:
        rig = AttackRig(config, robot, posture=STRETCHED, payload=0.1, seed=10).bring_up()
        rig.bridge.e_stop('of the test')
        rig.run(0.02)
        rig.world.script(once(rig.cycles, point, TIME_OUT - 2e-3))
        assert rig.bridge.clear_fault().accepted
        rig.run(0.12)
        assert rig.bridge.mode == 'ready', point
        assert is_driven(rig)


def test_exactly_the_time_out_is_no_time_out(config, robot):
    """A frame at the time-out keeps the board on; a later one does not."""
    for late, error in ((-1e-3, 0), (1e-3, 2)):
        rig = AttackRig(config, robot, posture=STRETCHED, settings=BridgeSettings())
        rig.bring_up()
        # A frame a millisecond: the pause adds to that.
        rig.world.script(once(10, WAKE, TIME_OUT + late - 1e-3))
        rig.run(0.08)
        assert [board.error for board in rig.boards.boards] == [error, error]
        assert rig.bridge.mode == ('fault' if error else 'ready')
        if error:
            assert 'error 2 (SPI receive time-out)' in rig.bridge.faults[0]


def test_after_a_clock_step_back_the_bridge_does_not_follow_a_dead_controller(make_rig):
    rig = make_rig().bring_up()
    rig.run(0.1, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    assert rig.bridge.mode == 'running'
    rig.now -= 5.0
    rig.run(0.1)
    assert rig.bridge.mode == 'damping'
    rig.run(0.1, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    assert rig.bridge.mode == 'running', rig.bridge.faults
