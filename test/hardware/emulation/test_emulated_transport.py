import numpy as np
import pytest

from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.frames.board_messages import BoardCommand
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.simulation.arm_plant import SUBSTEP, PlantParameters


@pytest.fixture
def boards(config, robot):
    return make_emulated_transport(config, robot, seed=None)


def test_advances_in_whole_substeps_to_the_given_time(boards):
    boards.advance(50.0)
    assert boards.plant.time == 0.0
    for cycle in range(1, 101):
        # A loop that wakes up to 90 us late, never early.
        boards.advance(50.0 + cycle * 1e-3 + (cycle % 10) * 1e-5)
        assert boards.plant.time == pytest.approx(cycle * 1e-3, abs=1e-9)


def test_running_ahead_of_the_next_cycle_neither_gains_nor_loses_time(boards):
    late = np.random.default_rng(1).uniform(0.0, 2e-4, 1000)
    boards.advance(50.0)
    for cycle, delay in enumerate(late.tolist(), start=1):
        now = 50.0 + cycle * 1e-3 + delay
        boards.advance(now)
        boards.advance(now + 1e-3)
    assert boards.plant.time == pytest.approx(1.001, abs=SUBSTEP)
    assert boards.slipped == 0.0


def test_after_a_gap_time_above_10_ms_is_skipped(boards):
    boards.advance(0.0)
    boards.advance(0.5)
    assert boards.plant.time == pytest.approx(0.010)
    assert boards.slipped == pytest.approx(0.490)
    boards.advance(0.501)
    assert boards.plant.time == pytest.approx(0.011)


@pytest.mark.parametrize('encoders', ['absolute', ''])
def test_boards_count_the_motors_angles_of_the_joints_that_they_drive(config, robot, encoders):
    q = np.array([0.3, 1.2, -0.4, 0.5])
    # Those of the profile count from where they were switched on.
    at_zero = q if encoders == '' else np.array([joint.offset for joint in config.joints])
    config = config.with_encoders(encoders)
    boards = make_emulated_transport(config, robot, seed=None, position=q)
    boards.advance(0.0)
    boards.advance(SUBSTEP)
    codec = FrameCodec(load_profile())
    for joint, angle, zero in zip(config.joints, q, at_zero, strict=True):
        state = codec.decode(boards.exchange(joint.board, codec.encode(BoardCommand())))
        motor_angle = joint.sign * (angle - zero) / joint.gear.ratio
        count = 2 * np.pi / 4096
        assert state.position[joint.channel] == pytest.approx(motor_angle, abs=count)


def test_currents_turn_the_joints_with_the_true_torque_constant(config, robot):
    parameters = PlantParameters.nominal(config, robot).perturbed(5).without_friction()
    boards = make_emulated_transport(config, robot, parameters=parameters)
    boards.advance(0.0)
    currents = [0.5, -0.25, 0.25, -0.5]
    for joint, current in zip(config.joints, currents, strict=True):
        motor = boards.boards[joint.board].motors[joint.channel]
        motor.ready, motor.current = True, current
        motor.enable(True)
    boards.advance(2e-3)
    gear = np.array(
        [joint.sign * joint.gear.efficiency / joint.gear.ratio for joint in config.joints]
    )
    effort = parameters.motor_torque_constant * gear * currents
    assert boards.plant._effort == pytest.approx(effort, rel=1e-3)


def test_the_arm_is_carried_until_all_motors_are_ready(boards):
    now = 0.0
    boards.advance(now)

    def run(seconds):
        nonlocal now
        for _ in range(round(seconds * 1000)):
            now += 1e-3
            boards.advance(now)

    motors = [motor for board in boards.boards for motor in board.motors]
    run(0.1)
    assert boards.plant.support == 1.0
    for motor in motors[:3]:
        motor.ready = True
        motor.enable(True)
    run(0.6)
    assert boards.plant.support == 1.0
    motors[3].ready = True
    motors[3].enable(True)
    run(0.25)
    assert 0.0 < boards.plant.support < 1.0
    run(0.3)
    assert boards.plant.support == 0.0
    boards.carry()
    assert boards.plant.support == 1.0


def test_a_caught_arm_is_reported_at_rest(rig):
    rig.bridge.disable()
    rig.plant.reset(rig.plant.position, [0.0, 2.0, 0.0, 0.0])
    rig.run(0.02)
    assert not rig.bridge.enable().accepted
    rig.boards.carry()
    rig.bridge.update(rig.now)  # without time in between
    assert not rig.bridge.dq.any()
    assert rig.bridge.enable().accepted


def test_starts_in_the_rest_position_as_another_arm_for_each_seed(config, robot):
    first, again, other = (make_emulated_transport(config, robot, seed) for seed in (1, 1, 2))
    assert first.plant.position == pytest.approx(np.array(config.rest_position))
    assert first.plant.true_parameters() == again.plant.true_parameters()
    assert first.plant.true_parameters() != other.plant.true_parameters()
    assert first.plant.true_parameters()['gravity_in_base'] == [0.0, 0.0, -9.81]
