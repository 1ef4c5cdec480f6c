"""The whole path: commands, gate, frames, boards, simulated arm, and back."""

from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.bridge_modes import MODES
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.model.dynamics import Dynamics

AMPLITUDE = np.array([0.4, 0.3, 0.5, 0.6])
OMEGA = 2 * np.pi * 0.4


def sine(start):
    """Return velocity references that swing all joints from rest."""

    def reference(now):
        t = now - start
        return None, AMPLITUDE * OMEGA * np.sin(OMEGA * t) * min(1.0, t), None

    return reference


def test_from_disconnected_to_ready(make_rig):
    rig = make_rig()
    assert rig.bridge.mode == 'disconnected'
    assert np.isnan(rig.bridge.q).all()
    seen, start, moved = [], rig.plant.position, 0.0
    for _ in range(1300):
        if rig.bridge.mode == 'idle':
            assert rig.bridge.enable().accepted
        rig.cycle()
        if rig.bridge.mode == 'aligning':
            moved = np.maximum(moved, np.abs(rig.plant.position - start))
        if rig.bridge.mode not in seen:
            seen.append(rig.bridge.mode)
    assert seen == ['disconnected', 'idle', 'aligning', 'ready']
    assert set(seen) < set(MODES)
    assert np.all((moved > 0.005) & (moved < 0.05))
    assert rig.plant.support == 0.0
    assert rig.bridge.q == pytest.approx(rig.plant.position, abs=1e-3)


def test_an_unsupported_loaded_arm_fails_to_align(make_rig):
    rig = make_rig(position=[0.0, 0.0, 0.0, 0.0])
    rig.enable()
    rig.plant.support = 0.0
    rig.run(0.8)
    assert rig.bridge.mode == 'fault'
    assert 'encoder' in rig.bridge.faults[0]


def test_ready_holds_the_arm_where_it_was_without_a_jump(make_rig):
    q = [0.3, 0.9, 0.4, -0.5]
    rig = make_rig(seed=2, position=q).bring_up()
    rig.run(0.8)
    # The spring of the boards' law carries the weight, so the arm sags by torque / stiffness.
    assert rig.plant.position == pytest.approx(q, abs=0.08)
    assert rig.speed < 1e-3
    assert rig.bridge.mode == 'ready'


def test_states_are_the_joints_states(rig):
    rig.run(1.0, sine(rig.now))
    assert rig.bridge.q == pytest.approx(rig.plant.position, abs=2e-3)
    assert rig.bridge.dq == pytest.approx(rig.plant.velocity, abs=0.1)
    assert rig.bridge.motor_position * rig.config.column('gear.ratio') == pytest.approx(
        rig.bridge.q
    )


@pytest.mark.parametrize('seed', [None, 3])
def test_velocity_loop_tracks_a_slow_sine_on_all_joints(make_rig, seed):
    rig = make_rig(seed=seed).bring_up()
    reference = sine(rig.now)
    errors = []
    for _ in range(3000):
        wanted = reference(rig.now)[1]
        rig.run(1e-3, reference)
        errors.append(rig.plant.velocity - wanted)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(rms < 0.1 * AMPLITUDE * OMEGA), rms
    assert rig.bridge.mode == 'running'
    assert not rig.bridge.intake.rejections


def test_position_with_velocity_and_effort_is_the_full_law(rig):
    start, model = rig.bridge.q.copy(), Dynamics(rig.robot)

    def reference(now, origin=rig.now):
        t = now - origin
        swing, blend = AMPLITUDE / 2, min(1.0, t)
        q = start + swing * (1 - np.cos(OMEGA * t)) * blend
        dq = swing * OMEGA * np.sin(OMEGA * t) * blend
        return q, dq, model.gravity(q)

    errors = []
    for _ in range(3000):
        wanted = reference(rig.now)[0]
        rig.run(1e-3, reference)
        errors.append(rig.plant.position - wanted)
    with_weight_fed_forward = np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.all(with_weight_fed_forward < 0.012), with_weight_fed_forward


def test_silence_of_the_controller_damps_the_arm_until_it_is_enabled(make_rig):
    rig = make_rig(position=[0.0, 0.8, 0.0, 0.0]).bring_up()
    rig.run(0.5, lambda now: (None, [1.0, 0.0, 1.0, 1.0], None))
    assert rig.speed > 0.9
    assert 'the arm follows a command' in rig.bridge.enable().message
    rig.run(0.04)
    assert rig.bridge.mode == 'running'
    height = rig.plant.position[1]
    rig.run(0.5)
    assert rig.bridge.mode == 'damping'
    assert any('no valid command for' in text for text in rig.bridge.faults)
    # The joints that carry no weight come to rest, the loaded one sinks slowly.
    assert np.abs(rig.plant.velocity[[0, 2]]).max() < 0.01
    assert -1.0 < rig.plant.velocity[1] < 0.0
    assert rig.plant.position[1] < height
    assert not rig.bridge.gate.stop
    answer = rig.bridge.enable()
    assert answer.accepted
    assert 'holds the arm in place' in answer.message
    rig.run(0.3)
    assert rig.bridge.mode == 'ready'
    held = rig.plant.position
    rig.run(0.5)
    assert rig.plant.position == pytest.approx(held, abs=2e-3)
    assert all(board.motors[0].ready for board in rig.boards.boards)  # without a new alignment


def test_after_damping_a_good_command_is_followed_again_from_where_the_arm_is(rig):
    rig.run(0.2, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    rig.run(0.3)
    assert rig.bridge.mode == 'damping'
    q = rig.plant.position
    rig.run(0.2, lambda now: (None, [0.0] * 4, None))
    assert rig.bridge.mode == 'running'
    assert rig.plant.position == pytest.approx(q, abs=0.01)


def test_an_arm_that_is_to_be_held_at_the_end_of_commands_is_never_damped(make_rig):
    rig = make_rig(position=[0.0, 0.8, 0.0, 0.0]).bring_up()
    answer = np.array([0.5, 0.0, 0.5, 0.5])
    rig.run(0.3, lambda now: (None, answer, None))
    assert rig.bridge.hold().message == 'the bridge holds the arm in place once commands end'
    rig.run(0.01, lambda now: (None, answer, None))  # what is under way is still of the same
    modes = set()
    for _ in range(500):
        rig.cycle()
        modes.add(rig.bridge.mode)
    assert modes == {'running', 'ready'}
    assert rig.bridge.mode == 'ready'
    held = rig.plant.position
    rig.run(0.5)
    assert rig.plant.position == pytest.approx(held, abs=2e-3)


def test_a_hold_request_does_not_apply_to_the_next_controller(make_rig):
    rig = make_rig(position=[0.0, 0.8, 0.0, 0.0]).bring_up()
    rig.run(0.1, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))
    rig.bridge.hold()
    rig.run(0.2, lambda now: (None, [0.5, 0.0, 0.0, 0.0], None))  # another goes on, and dies
    assert rig.bridge.mode == 'running'
    rig.run(0.2)
    assert rig.bridge.mode == 'damping'
    assert rig.bridge.hold().message == 'the bridge holds the arm in place'
    rig.run(0.2)
    assert rig.bridge.mode == 'ready'
    rig.bridge.e_stop('test')
    rig.run(0.1)
    answer = rig.bridge.hold()
    assert not answer.accepted
    assert answer.message == "arm_mode is fault: run 'arm clear_fault' first"


def test_a_rejected_stream_damps_the_arm_and_is_reported(rig):
    rig.run(0.3, lambda now: (None, [0.5, 0.0, 0.5, 0.5], None))
    for _ in range(300):
        assert not rig.send(velocity=[np.nan, 0.0, 0.0, 0.0])
        rig.cycle()
    assert rig.bridge.mode == 'damping'
    assert rig.bridge.intake.rejections == {'nan': 300}
    assert rig.bridge.counters['rejected nan'] == 300
    assert any('no reference at all' in text for text in rig.bridge.faults)
    assert rig.speed < 0.01


def test_commands_before_ready_are_rejected(make_rig):
    rig, modes = make_rig(), []
    for step in (lambda: None, lambda: rig.run(0.02), rig.enable, lambda: rig.run(0.1)):
        step()
        modes.append(rig.bridge.mode)
        assert not rig.send(velocity=[0.1] * 4)
    assert modes == ['disconnected', 'idle', 'aligning', 'aligning']
    assert rig.bridge.intake.rejections == {'not_ready': 4}


def test_disable_switches_off_and_enabling_aligns_again(rig):
    assert rig.bridge.disable().accepted
    rig.run(0.05)
    assert rig.bridge.mode == 'idle'
    assert not any(board.system_enabled for board in rig.boards.boards)
    rig.boards.carry()
    rig.bridge.enable()
    rig.run(0.1)
    assert rig.bridge.mode == 'aligning'
    rig.run(0.6)
    assert rig.bridge.mode == 'ready'


def test_thesis_profile_runs_the_velocity_loop_and_reads_power(config, make_rig):
    rig = make_rig(config=replace(config, profile='laas_power')).bring_up()
    rig.bridge.references.set_gains(5.0, config.column('board_kd'), 2.0)
    rig.run(1.0, lambda now: (None, [0.5, 0.0, 0.3, 0.3], None))
    assert rig.plant.velocity[[0, 2, 3]] == pytest.approx([0.5, 0.3, 0.3], abs=0.05)
    assert rig.bridge.power.source == 'voltage'
    assert rig.bridge.motor_power[0] > 0.0
    assert not rig.send(effort=[0.0] * 4)
    assert rig.bridge.intake.rejections == {'unsupported': 1}


def test_motors_that_turn_against_their_joints(config, make_rig):
    joints = tuple(replace(joint, sign=-1, offset=0.2) for joint in config.joints)
    rig = make_rig(config=replace(config, joints=joints)).bring_up()
    rig.run(0.5, lambda now: (None, [0.4, 0.0, -0.4, 0.4], None))
    assert rig.plant.velocity[[0, 2, 3]] == pytest.approx([0.4, -0.4, 0.4], abs=0.05)
    assert rig.bridge.q == pytest.approx(rig.plant.position, abs=2e-3)
    assert rig.bridge.motor_velocity[0] < 0.0


def test_runs_are_repeated_to_the_bit(make_rig):
    def run():
        rig = make_rig(seed=5).bring_up()
        return rig.run(0.5, sine(rig.now))

    assert np.array_equal(run(), run())


def test_late_and_missed_cycles_do_no_harm(rig):
    random = np.random.default_rng(1)
    reference = sine(rig.now)
    for _ in range(1500):
        rig.now += random.choice([0.0, 0.0002, 0.004, 0.008], p=[0.4, 0.3, 0.2, 0.1])
        rig.run(1e-3, reference)
    assert rig.bridge.mode == 'running', rig.bridge.faults
    assert np.abs(rig.plant.velocity).max() < 2.0


def test_limits_that_no_frame_can_represent_are_rejected_at_start(config, robot, coarse_profile):
    # A saturation in steps of 40 A is 0 for these motors, which some boards take for none.
    profile = coarse_profile('current_saturation', 40.0)
    with pytest.raises(ValueError, match='limits cannot be sent to board0: current_saturation'):
        BridgeCycle(config, make_emulated_transport(config, robot), profile=profile)
