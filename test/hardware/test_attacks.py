"""Promised limits under every kind of attack; `make attacks` runs hundreds more."""

import numpy as np
import pytest
from attack_campaign import BEYOND_MAX, SPEED_MAX, Outcome, run
from attack_rig import AttackRig, Offer
from attack_zeros import attack_restart, attack_unknown
from attacks import ATTACKS

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

# What a board's integral and a base that is turned add; joint 1 throws a heavy arm outward;
# a load that changes as the reference moves holds joint 2 still, as if its encoder were stuck.
SPECIAL = [('position', 7), ('position', 15), ('full_law', 4), ('full_law', 11), ('swinging', 9)]
SPECIAL.append(('velocity', 54))
PUSH = 9.0  # [Nm] or [rad/s], beyond any limit

# Number 1 has gains of its own, 2 and 5 other arms.
NUMBERS = {name: (1, 2) if index % 2 else (3, 5) for index, name in enumerate(ATTACKS)}


@pytest.mark.parametrize(
    ('attack', 'number'),
    [*((name, number) for name in ATTACKS for number in NUMBERS[name]), *SPECIAL],
)
def test_no_attack_breaks_a_limit(attack: str, number: int) -> None:
    keeps_limits(run(attack, number, 1.5 if (attack, number) in SPECIAL else 0.7))


@pytest.mark.parametrize('attack', ['velocity', 'full_law', 'any_mode'])
def test_nothing_but_homing_moves_an_arm_that_was_just_switched_on(attack: str) -> None:
    outcome = attack_unknown(attack, 1)
    assert outcome.is_clean, outcome


@pytest.mark.parametrize('number', [1, 2, 3])
def test_a_restart_amid_an_attack_keeps_only_zeros_that_hold(number: int) -> None:
    outcome = attack_restart('velocity', number)
    assert outcome.is_clean, outcome
    assert outcome.beyond <= BEYOND_MAX, outcome


def keeps_limits(outcome: Outcome) -> None:
    assert outcome.beyond <= BEYOND_MAX, outcome
    assert outcome.speed <= SPEED_MAX, outcome
    assert not outcome.is_doubted, outcome


@pytest.mark.parametrize(
    ('period', 'attack', 'number'),
    # An encoder of 2 kHz says less of the speed in each frame.
    [(0.5e-3, 'effort_against_reference', 100), (2e-3, 'stopping', 101)],
)
def test_another_period_breaks_no_limit_either(period: float, attack: str, number: int) -> None:
    keeps_limits(run(attack, number, settings=BridgeSettings(period=period)))


@pytest.mark.parametrize('way', [1.0, -1.0])
@pytest.mark.parametrize('mode', ['velocity', 'effort'])
def test_joint_2_with_the_rated_payload_stops_before_its_limit(config, robot, mode, way):
    # From upright, so that its weight helps it on all the way; the drive has 3 Nm to spare.
    push = np.array([0.0, PUSH * way, 0.0, 0.0])
    rig = AttackRig(config, robot, payload=config.rated_payload[0]).bring_up()
    offer = Offer(velocity=push * 0.65) if mode == 'velocity' else Offer(effort=2.0 * push)
    log = rig.run(1.3, lambda rig: offer)
    assert np.abs(log.dq[:, 1]).max() > 3.0
    assert log.beyond(config)[1] == pytest.approx(0.0, abs=0.01)
    assert set(log.modes) == {'running'}, log.faults
    assert abs(log.dq[-1, 1]) < 0.05


@pytest.mark.parametrize('mode', ['full law', 'effort'])
def test_on_a_base_turned_over_no_joint_exceeds_the_guaranteed_speed(config, robot, mode):
    # All that the bridge knows of the weight, with the rated payload, is the wrong way round.
    start, up = [0.0, -0.3, 0.0, 0.0], [0.0, 0.0, 9.81]
    payload = config.rated_payload[0]
    rig = AttackRig(config, robot, posture=start, payload=payload, gravity=up).bring_up()
    ahead, push = np.array([0.0, 0.4, 0.0, 0.0]), np.array([0.0, PUSH, 0.0, 0.0])

    def offer(rig: AttackRig) -> Offer:
        if mode == 'effort':
            return Offer(effort=push)
        return Offer(rig.bridge.q + ahead, 0.5 * push, push)

    log = rig.run(0.7, offer)
    assert 1.0 < log.speed_ratio(config)[1] < 1.09
    assert log.beyond(config).max() < BEYOND_MAX


def test_friction_that_grows_with_the_weight_is_no_stuck_encoder():
    # On a tilted base joint 1 carries weight too: led on slowly, it stands while its current falls.
    outcome = run('velocity', 19, seconds=1.3)
    assert outcome.faults == ()
    assert outcome.beyond <= BEYOND_MAX


def test_a_joint_may_be_led_up_to_its_limit(config, robot):
    top = config.column('position_max')
    start = [0.0, np.pi / 2, 0.0, top[3] - 0.3]
    rig = AttackRig(config, robot, posture=start).bring_up()
    rig.run(1.0, lambda rig: Offer(position=[0.0, np.pi / 2, 0.0, top[3]]))
    assert rig.plant.position[3] == pytest.approx(top[3], abs=0.005)
    rig.run(0.3, lambda rig: Offer(velocity=[0.0, 0.0, 0.0, -1.0]))
    assert rig.plant.position[3] == pytest.approx(top[3] - 0.3, abs=0.05)


def test_full_torque_does_not_overspeed(config, robot):
    rig = AttackRig(config, robot, posture=[0.0, np.pi / 2, 0.0, -1.5]).bring_up()
    log = rig.run(
        0.4, lambda rig: Offer(effort=[np.nan, np.nan, np.nan, 9.39], velocity=[0.0] * 3 + [np.nan])
    )
    assert 1.0 < log.speed_ratio(config)[3] < SPEED_MAX
    # As fast as the limit allows, for as long as there is way.
    assert (log.dq[:, 3] > 0.95 * config.joints[3].velocity_max).sum() > 300


def test_a_stopped_arm_sinks_slowly_and_not_through_its_limit(config, robot):
    rig = AttackRig(config, robot, posture=[0.0, 0.0, 0.0, 0.0], payload=0.2).bring_up()
    rig.bridge.e_stop('test')
    log = rig.run(1.5)
    assert set(log.modes) == {'fault'}
    assert 0.3 < np.abs(log.dq[:, 1]).max() < 0.4 * config.joints[1].velocity_max
    assert log.beyond(config)[1] < 0.01
    assert rig.plant.position[1] < config.joints[1].position_min + 0.05


@pytest.mark.parametrize('fault', ['over_temperature', 'power_cycle'])
def test_a_joint_is_held_at_its_limit_while_the_other_board_is_off(config, robot, fault):
    # Joint 2 sinks towards its lower limit; joints 3 and 4 hang free.
    rig = AttackRig(config, robot, posture=[0.0, -0.45, 0.0, 0.0], payload=0.1).bring_up()
    rig.inject(fault, 1)
    log = rig.run(0.8)
    assert rig.bridge.mode == 'fault'
    assert log.q[-1, 1] < -0.5
    assert log.beyond(config)[1] < 0.02


def test_far_from_limits_commands_reach_the_boards_as_they_are(config, robot):
    rig = AttackRig(config, robot).bring_up()
    q, dq, tau = rig.bridge.q + 0.01, np.array([0.5, -0.5, 1.0, -1.0]), np.full(4, 0.3)
    rig.run(0.05, lambda rig: Offer(q, dq, tau))
    drive = rig.bridge.references._drive
    sent = [rig.frames.commands(board) for board in (0, 1)]
    for joint, config_joint in enumerate(config.joints):
        frame = sent[config_joint.board]
        channel = config_joint.channel
        assert frame['position'][-1, channel] == pytest.approx(
            drive.joint_to_motor_position(q)[joint], abs=1e-6
        )
        assert frame['velocity'][-1, channel] == pytest.approx(
            drive.joint_to_motor_velocity(dq)[joint], abs=0.03
        )
        assert frame['current'][-1, channel] == pytest.approx(
            drive.effort_to_current(tau)[joint], abs=1e-3
        )
    assert 'limited braking' not in rig.bridge.counters


@pytest.mark.parametrize(('board', 'motor'), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_an_encoder_that_goes_mad_moves_no_other_joint(config, robot, board, motor):
    # What the others carry must not be reckoned from its numbers.
    posture, payload = [0.0, 0.3, 0.0, 1.9], config.rated_payload[0]
    rig = AttackRig(config, robot, posture=posture, payload=payload, seed=3).bring_up()
    for jump in (3.0, -3.0, 10.0, -20.0) * 8:
        rig.inject('encoder_jump', board, motor, jump)
        log = rig.run(0.004)
    mad = next(
        number
        for number, joint in enumerate(config.joints)
        if (joint.board, joint.channel) == (board, motor)
    )
    others = np.delete(log.speed_ratio(config), mad)
    assert rig.bridge.mode == 'fault'
    # Without a motor at one joint the whole arm swings.
    assert others.max() < 0.5
    assert log.beyond(config).max() < BEYOND_MAX
