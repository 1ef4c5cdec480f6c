"""Warm motors on the whole bridge: warnings, limits and stops."""

from dataclasses import replace

import numpy as np
import pytest
from attack_rig import AttackRig, Offer
from attacks import ATTACKS

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

COLD = BridgeSettings(start_temperature=25.0)


def quick(config: ArmConfig, factor: float, profile: str = 'uomodri_v3') -> ArmConfig:
    """Return an arm whose motors warm and cool faster by a factor; all else is equal."""

    def quicker(joint):
        thermal = joint.motor.thermal
        times = {key: getattr(thermal, key) / factor for key in ('winding_time', 'housing_time')}
        return replace(joint, motor=replace(joint.motor, thermal=replace(thermal, **times)))

    return replace(config, joints=tuple(map(quicker, config.joints)), profile=profile)


def events(rig: AttackRig, joint: int) -> dict[str, bool]:
    """Return the present events of a joint's motor."""
    limit = rig.bridge.heat.limits[joint]
    board = rig.config.joints[joint].board
    return {
        'warning': bool(limit.warning()),
        'reduction': limit.is_reduced,
        'sinking': limit.is_sinking,
        'stop': bool(rig.bridge.gate.stop),
        'let down': limit.is_released,
        'error 3': rig.boards.boards[board].error == 3,
    }


def warmed(rig: AttackRig, estimated: float, true: float) -> AttackRig:
    """Set the bridge's estimated and the true winding temperatures of all motors."""
    for limit in rig.bridge.heat.limits:
        limit.motor.winding, limit.motor.housing = estimated, min(estimated, 70.0)
    for board in rig.boards.boards:
        for motor in board.motors:
            motor.heat.warm(true)
    return rig


def test_a_stretched_arm_is_warned_reduced_stopped_and_lowered_before_its_board_fails(
    config, robot
):
    arm = quick(config, 8.0)
    rig = AttackRig(arm, robot, posture=[0.0] * 4, payload=0.2, seed=4, settings=COLD).bring_up()
    warmed(rig, 78.0, 78.0)
    first: dict[str, float] = {}
    sinking_speed = 0.0
    for cycle in range(5000):
        if 'let down' in first and 1e-3 * cycle > first['let down'] + 0.6:
            break
        rig.cycle()
        for name, holds in events(rig, 1).items():
            if holds:
                first.setdefault(name, 1e-3 * cycle)
        if 'sinking' in first and 'stop' not in first:
            sinking_speed = max(sinking_speed, abs(rig.plant.velocity[1]))
        if 'let down' not in first:
            assert rig.plant.position[1] > config.joints[1].position_min - 0.01
    assert list(first) == ['warning', 'reduction', 'sinking', 'stop', 'let down'], first
    assert 'joint2 has 11' in rig.bridge.gate.stop
    assert sinking_speed < 0.16 * config.joints[1].velocity_max
    # On its mechanical stop it needs no current, and cools.
    assert rig.plant.position[1] < config.joints[1].position_min - 0.05
    assert abs(rig.boards.boards[0].motors[1].torque_current) < 0.5
    assert rig.log.speed_ratio(config).max() < 0.2
    assert not rig.bridge.clear_fault().accepted
    # Each step is news once, and the way back names what to wait for.
    news = [text for text in rig.bridge.heat.news if 'joint2' in text]
    steps = ('the motor of joint2', 'the torque of joint2', 'joint2 sinks', 'joint2 yields')
    assert len(news) == len(steps)
    assert all(step in text for step, text in zip(steps, news, strict=True)), news
    assert 'wait until the motor of joint2 has cooled to 90 degC, ' in rig.bridge.recovery_hint(
        True
    )
    assert rig.bridge.recovery_hint(True).startswith("'arm disable'")


def test_a_warm_arm_can_be_folded_with_its_payload(config, robot):
    rig = AttackRig(config, robot, posture=[0.0] * 4, payload=0.2).bring_up()
    warmed(rig, 92.0, 85.0).run(0.1)
    assert rig.bridge.heat.limits[1].is_reduced
    rig.run(1.5, lambda rig: Offer(velocity=[0.0, 2.0 * (1.5708 - rig.bridge.q[1]), 0.0, 0.0]))
    assert rig.plant.position[1] > 1.3
    assert rig.bridge.mode == 'running', rig.bridge.faults


@pytest.mark.parametrize('attack', ['velocity', 'effort', 'pump', 'full_law', 'effort_waves'])
def test_limits_hold_while_torques_are_reduced(config, robot, attack):
    rig = warmed(AttackRig(config, robot, payload=0.2, seed=2).bring_up(), 104.0, 95.0)
    rig.run(0.6)
    assert all(limit.is_reduced for limit in rig.bridge.heat.limits)
    log = rig.run(0.8, ATTACKS[attack](np.random.default_rng(1)))
    assert log.beyond(config).max() < 0.01
    assert log.speed_ratio(config).max() < 1.15
    assert log.accepted > 500
    assert not any(board.error for board in rig.boards.boards)


@pytest.mark.parametrize('ahead', [None, 0.45], ids=['effort', 'full law'])
def test_a_command_is_limited_to_the_reduced_torque(config, robot, ahead):
    rig = warmed(AttackRig(config, robot).bring_up(), 107.0, 95.0)
    limit, motor = rig.bridge.heat.limits[0], rig.boards.boards[0].motors[0]
    rig.run(0.7)
    # The board computes the law of a position reference.
    position = None if ahead is None else rig.bridge.q + [ahead, 0.0, 0.0, 0.0]
    seen = []
    for _ in range(15):
        rig.cycle(lambda rig: Offer(position=position, effort=[17.0, 0.0, 0.0, 0.0]))
        seen.append(motor.torque_current)
    assert limit.effort_limit < 0.5 * config.joints[0].effort_max
    # By then all the torque would take 15 A.
    assert 0.8 * limit.continuous_current < max(seen) < limit.continuous_current + 0.2


def test_ordinary_motion_loses_no_torque(config, robot):
    """Minutes of swings with warm motors; the test's heat model is 50 times as fast."""
    rig = AttackRig(quick(config, 50.0), robot, seed=3).bring_up()

    def swing(rig: AttackRig) -> Offer:
        phase = 2.0 * np.pi * (rig.now % 1.0)
        return Offer(velocity=np.array([2.0, 1.0, 2.5, 2.5]) * np.cos(phase))

    for _ in range(1200):
        rig.cycle(swing)
        assert not any(limit.is_reduced for limit in rig.bridge.heat.limits)
    assert rig.bridge.mode == 'running', rig.bridge.faults


def test_a_hot_arm_is_not_enabled_until_it_has_cooled(config, robot):
    rig = AttackRig(quick(config, 50.0), robot)
    rig.run(0.05)
    motor = rig.bridge.heat.limits[0].motor
    motor.winding = motor.housing = 105.0
    answer = rig.bridge.enable()
    assert not answer.accepted
    assert 'joint1 has 105 degC' in answer.message
    rig.run(2.0)
    assert rig.bridge.enable().accepted


@pytest.mark.parametrize('disabled', [True, False])
def test_the_last_current_of_a_board_without_supply_warms_no_motor(config, robot, disabled):
    arm = quick(config, 50.0)
    rig = AttackRig(arm, robot, posture=[0.0, 1.2, 0.0, 0.0], payload=0.2, settings=COLD)
    rig.bring_up().run(0.05, lambda rig: Offer(effort=[0.0, 9.0, 0.0, 0.0]))
    assert rig.bridge.motor_current[1] > 10.0
    rig.inject('dead_board', 0)
    rig.run(0.05)
    if disabled:
        rig.bridge.disable()
    rig.run(3.2)  # as 160 s of the arm as drawn
    winding = rig.bridge.heat.limits[1].motor.winding
    if disabled:
        assert winding < 60.0
    else:  # the board may hear, and damp its joints
        assert winding < arm.joints[1].motor.thermal.temperature_max


def test_a_critical_temperature_is_the_boards_error(config, robot):
    rig = AttackRig(config, robot).bring_up()
    rig.inject('warm_motor', 1, 0, 140.0)
    rig.run(0.1)
    assert rig.boards.boards[1].error == 3
    assert 'critical temperature' in rig.bridge.gate.stop


@pytest.mark.parametrize(
    ('fault', 'value', 'text'),
    [('supply_voltage', 16.0, 'charge the battery'), ('no_sink', 1e-4, 'braking energy')],
)
def test_a_supply_beyond_its_limits_stops_the_arm(config, robot, fault, value, text):
    arm = quick(config, 1.0, 'laas_power')
    rig = AttackRig(arm, robot).bring_up()
    rig.inject(fault, 0, 0, value)
    assert not rig.log.faults
    rig.run(1.2, lambda rig: Offer(velocity=[5.0 * np.sign(np.sin(12.0 * rig.now)), 0.0, 0.0, 0.0]))
    assert text in rig.bridge.gate.stop, rig.bridge.heat.supplies[0].voltage
    rig.run(0.5)
    assert np.abs(rig.plant.velocity).max() < 0.5


def test_a_battery_takes_braking_energy_back(config, robot):
    rig = AttackRig(quick(config, 1.0, 'laas_power'), robot).bring_up()
    voltages = []

    def shake(rig: AttackRig) -> Offer:
        voltages.append(rig.bridge.heat.supplies[0].voltage)
        return Offer(velocity=[5.0 * np.sign(np.sin(12.0 * rig.now)), 0.0, 0.0, 0.0])

    rig.run(1.2, shake)
    assert not rig.bridge.gate.stop
    assert min(voltages) > 23.0
    assert max(voltages) < 25.0
