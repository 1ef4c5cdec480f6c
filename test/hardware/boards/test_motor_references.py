import math
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.description.arm_config import DriveTrain, load_arm_config
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import CommandBuffer
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier

Q = np.array([0.1, 1.5, -0.2, 0.3])
TRUSTED = [True] * 4
DT = 1e-3


@pytest.fixture(scope='module')
def config():
    """Return an arm whose joints differ in sign and offset."""
    arm = load_arm_config()
    joints = enumerate(arm.joints)
    turned = (replace(joint, sign=(-1) ** i, offset=0.1 * i - 0.15) for i, joint in joints)
    return replace(arm, joints=tuple(turned))


@pytest.fixture
def references(config):
    return MotorReferences(config, load_profile(), reach_max=0.5)


@pytest.fixture
def drive(config):
    return DriveTrain(config)


def make_barriers(config, q, highest=(99.0,) * 4, lowest=(-99.0,) * 4):
    """Return barriers of joints at rest that accept torques between two bounds."""
    barriers = []
    for i, joint in enumerate(config.joints):
        barrier = JointBarrier(joint, BridgeSettings(), 10.0, 0.1)
        barrier.q, barrier.highest, barrier.lowest = q[i], highest[i], lowest[i]
        barriers.append(barrier)
    return barriers


def get(references, name):
    return np.array([getattr(motor, name) for motor in references.motors])


def track(references, command, q, dt):
    """Let each motor follow its joint's references."""
    rows = zip(references.motors, command.q, command.dq, command.tau, q, strict=True)
    for motor, position, velocity, effort, angle in rows:
        motor.track(position, velocity, effort, angle, dt)


def command(**values):
    result = CommandBuffer(4)
    for name, value in values.items():
        getattr(result, name)[:] = value
    return result


def test_full_law_passes_everything_on_in_motor_units(references, drive, config):
    p, v, e = Q + 0.01, np.array([1, -1, 2, -2.0]), np.array([0.1, 0.2, 0.3, 0.4])
    track(references, command(q=p, dq=v, tau=e), Q, DT)
    assert get(references, 'position') == pytest.approx(drive.joint_to_motor_position(p))
    assert get(references, 'velocity') == pytest.approx(drive.joint_to_motor_velocity(v))
    assert get(references, 'current') == pytest.approx(drive.effort_to_current(e))
    assert get(references, 'kp') == pytest.approx(config.column('board_kp'))
    assert get(references, 'kd') == pytest.approx(config.column('board_kd'))


def test_effort_alone_is_torque_control_without_gains(references, drive):
    track(references, command(tau=1.0), Q, DT)
    assert not get(references, 'kp').any()
    assert not get(references, 'kd').any()
    assert not get(references, 'velocity').any()
    assert get(references, 'current') == pytest.approx(drive.effort_to_current(np.ones(4)))
    assert np.isnan(get(references, 'joint_position')).all()


def test_velocity_alone_is_integrated_from_where_the_joint_is(references, drive):
    velocity = np.array([0.5, -0.5, 1.0, -1.0])
    for _ in range(10):
        track(references, command(dq=velocity), Q, DT)
    assert get(references, 'joint_position') == pytest.approx(Q + 10 * DT * velocity)
    assert get(references, 'position') == pytest.approx(
        drive.joint_to_motor_position(Q + 10 * DT * velocity)
    )
    assert get(references, 'velocity') == pytest.approx(drive.joint_to_motor_velocity(velocity))
    assert not get(references, 'current').any()


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_the_integrated_reference_stays_within_effort_and_position_limits(
    references, drive, config, way
):
    for _ in range(2000):
        track(references, command(dq=4.0 * way), Q, DT)
    stiffness = drive.motor_to_joint_gain(config.column('board_kp'))
    pull = stiffness * (get(references, 'joint_position') - Q)
    assert pull == pytest.approx(way * config.column('effort_max'))
    assert references.torques(Q, np.zeros(4)) == pytest.approx(way * config.column('effort_max'))
    track(references, command(dq=-4.0 * way), Q, DT)
    assert np.all(way * stiffness * (get(references, 'joint_position') - Q) < way * pull)
    end = config.column('position_max' if way > 0.0 else 'position_min')
    for _ in range(100):
        track(references, command(dq=4.0 * way), end - 0.01 * way, DT)
    assert get(references, 'joint_position') == pytest.approx(end)


def test_a_warm_motor_gets_less_current_unless_it_brakes(references, config):
    track(references, command(tau=4.0), Q, DT)
    assert not np.isfinite(get(references, 'current_max')).any()
    for motor in references.motors:
        motor.effort_limit = 2.0
    track(references, command(tau=-4.0), Q, DT)
    per_ampere = config.column('torque_per_ampere')
    assert get(references, 'current_max') == pytest.approx(2.0 / per_ampere)
    assert references.torques(Q, np.zeros(4)) == pytest.approx(-2.0)
    # A limit needs all the torque that there is.
    assert references.keep_within(make_barriers(config, q=Q, lowest=[5.0] * 4), TRUSTED)
    assert references.torques(Q, np.zeros(4)) == pytest.approx(5.0)
    assert not np.isfinite(get(references, 'current_max')).any()


@pytest.mark.parametrize('gains', [(0.05, 0.02), (0.0, 0.02), (0.05, 0.0)])
def test_a_weak_law_that_is_unsafe_during_a_host_delay_becomes_damping_of_its_torque(
    references, config, gains
):
    references.set_gains(*gains)
    barriers = make_barriers(config, q=Q)
    for barrier in barriers:
        barrier.inertia, barrier.dq, barrier.filtered = 0.01, 1.0, 0.9
    track(references, command(q=Q + 0.1, dq=1.0, tau=5.0), Q, DT)
    speed = np.full(4, 0.9)
    asked = references.torques(Q, speed)
    assert not references.keep_within(barriers, TRUSTED)
    assert references.torques(Q, speed) == pytest.approx(asked)
    assert not get(references, 'kp').any()
    assert not get(references, 'current').any()
    assert (get(references, 'kd') > gains[1]).all()
    # It is gone at little more than the speed limit.
    assert (references.torques(Q, np.full(4, 6.0)) < 1.0).all()


def test_a_board_that_lost_its_last_commands_goes_on_with_an_older_one(references):
    for tau in (1.0, 2.0, 3.0):
        track(references, command(tau=tau), Q, DT)
        references.note_sent()
    zero = np.zeros(4)
    assert np.isnan(references.kept_torques(Q, zero, [0] * 4)).all()
    kept = references.kept_torques(Q, zero, [0, 1, 2, 9])
    assert kept == pytest.approx([np.nan, 2.0, 1.0, 1.0], nan_ok=True)
    track(references, command(q=Q + 0.01), Q, DT)
    references.note_sent()
    stiff = references.torques(Q, zero + 0.1)
    track(references, command(tau=-9.0), Q, DT)
    references.note_sent()
    assert references.kept_torques(Q, zero + 0.1, [1] * 4) == pytest.approx(stiff)


def test_integration_restarts_after_torque_control_or_damping(references):
    for _ in range(50):
        track(references, command(dq=1.0), Q, DT)
    track(references, command(tau=0.0), Q, DT)
    track(references, command(dq=0.0), Q, DT)
    assert get(references, 'joint_position') == pytest.approx(Q)
    track(references, command(dq=1.0), Q, DT)
    references.damp(np.full(4, np.inf))
    track(references, command(dq=0.0), Q, DT)
    assert get(references, 'joint_position') == pytest.approx(Q)


def test_from_position_to_velocity_without_a_jump(references):
    track(references, command(q=Q + 0.05), Q, DT)
    track(references, command(dq=0.0), Q, DT)
    assert get(references, 'joint_position') == pytest.approx(Q + 0.05)


def test_each_joint_has_its_own_mode(references, drive):
    given = command()
    given.q[0], given.dq[1], given.tau[2] = 0.12, 1.0, 0.5
    given.q[3], given.dq[3], given.tau[3] = 0.31, 0.2, 0.1
    track(references, given, Q, DT)
    assert (get(references, 'kp') > 0).tolist() == [True, True, False, True]
    assert (get(references, 'kd') > 0).tolist() == [True, True, False, True]
    assert (get(references, 'current') != 0).tolist() == [False, False, True, True]
    kp, kd = zip(*references.gains, strict=True)
    assert list(kp) == get(references, 'kp').tolist()
    assert list(kd) == get(references, 'kd').tolist()
    assert get(references, 'joint_position') == pytest.approx(
        [0.12, 1.501, math.nan, 0.31], nan_ok=True
    )


def test_a_joint_at_its_barrier_gets_the_torque_that_passes(references, drive, config):
    barriers = make_barriers(
        config, q=Q, highest=[9.0, 2.0, 0.5, 9.0], lowest=[-9.0, -9.0, -9.0, 1.5]
    )
    track(references, command(tau=[1.0, 3.0, 1.0, 1.0]), Q, DT)
    assert references.keep_within(barriers, TRUSTED)
    torques = references.torques(Q, np.zeros(4))
    assert torques == pytest.approx([1.0, 2.0, 0.5, 1.5])
    # What holds it is damping, so its own speed lowers the torque, and needs no current field.
    assert get(references, 'current')[1:] == pytest.approx(0.0)
    assert get(references, 'kd') == pytest.approx([0.0, *config.column('board_kd')[1:]])
    damping = drive.motor_to_joint_gain(config.column('board_kd'))[1:]
    assert references.torques(Q, np.full(4, 0.1))[1:] == pytest.approx(torques[1:] - 0.1 * damping)


def test_a_braked_joint_is_held_where_it_is_with_the_load_that_is_known(references, drive, config):
    zero = np.array([0.2, -0.3, 0.4, 0.5])
    references.set_zero(zero)
    barriers = make_barriers(config, q=Q, highest=[0.5] * 4)
    for number, barrier in enumerate(barriers):
        barrier.load, barrier.noise = 0.1 + number, 0.3 + number
    track(references, command(tau=2.0), Q, DT)
    assert references.keep_within(barriers, TRUSTED)
    assert get(references, 'position') == pytest.approx(drive.joint_to_motor_position(Q) + zero)
    loads, noises = np.arange(4) + 0.1, np.arange(4) + 0.3
    assert get(references, 'load_current') == pytest.approx(drive.effort_to_current(loads))
    assert get(references, 'noise') == pytest.approx(np.abs(drive.effort_to_current(noises)))
    track(references, command(tau=0.2), Q, DT)
    references.keep_within(barriers, TRUSTED)
    assert get(references, 'load_current') == pytest.approx(
        drive.effort_to_current(np.full(4, 0.2))
    )
    assert not get(references, 'noise').any()


def test_a_braking_torque_unsafe_during_a_host_delay_is_damped_about_the_predicted_speed(
    references, config
):
    barriers = make_barriers(config, q=Q, highest=[5.0] * 4)
    for barrier in barriers:
        barrier.inertia, barrier.dq, barrier.filtered = 0.01, 1.0, 0.9
    track(references, command(tau=8.0), Q, DT)
    assert references.keep_within(barriers, TRUSTED)
    mean = np.array([barrier.mean_filtered(5.0) for barrier in barriers])
    assert (np.abs(mean - 0.9) > 0.05).all()
    assert references.torques(Q, mean) == pytest.approx(5.0)


def test_references_within_a_barrier_are_unchanged(references, config):
    track(references, command(q=Q, dq=0.1, tau=1.0), Q, DT)
    before = [get(references, name) for name in ('position', 'velocity', 'current', 'kp', 'kd')]
    assert not references.keep_within(make_barriers(config, q=Q), TRUSTED)
    after = [get(references, name) for name in ('position', 'velocity', 'current', 'kp', 'kd')]
    assert np.array_equal(before, after)


def test_a_torque_unsafe_during_a_host_delay_is_damped_on_the_board(references, drive, config):
    barriers = make_barriers(config, q=Q)
    for barrier in barriers:
        barrier.inertia, barrier.dq, barrier.filtered = 0.01, 1.0, 0.9
    asked = np.array([5.0, 0.5, -5.0, 9.0])
    track(references, command(tau=asked), Q, DT)
    assert not references.keep_within(barriers, TRUSTED)
    assert (get(references, 'kd') > 0.0).tolist() == [True, False, True, True]
    assert get(references, 'kp').tolist() == [0.0] * 4
    # In the mean of a cycle it is the torque that was asked for.
    mean = np.array(
        [barrier.mean_filtered(tau) for barrier, tau in zip(barriers, asked, strict=True)]
    )
    assert references.torques(Q, mean) == pytest.approx(asked)
    # It is gone at little more than the speed limit.
    assert 0.0 < references.torques(Q, np.full(4, 5.4))[3] < 1.0
    # What has gains of its own is left alone, and so is what comes next.
    track(references, command(q=Q, dq=0.1, tau=asked), Q, DT)
    references.keep_within(barriers, TRUSTED)
    assert get(references, 'kd') == pytest.approx(config.column('board_kd'))
    track(references, command(tau=0.1), Q, DT)
    references.keep_within(barriers, TRUSTED)
    assert get(references, 'kd').tolist() == [0.0] * 4
    assert get(references, 'velocity').tolist() == [0.0] * 4


def test_a_joint_without_a_trusted_encoder_has_no_barrier(references, config):
    track(references, command(tau=1.0), Q, DT)
    barriers = make_barriers(config, q=Q, highest=[0.0] * 4)
    assert references.keep_within(barriers, [False, True, True, True])
    assert references.torques(Q, np.zeros(4)) == pytest.approx([1.0, 0.0, 0.0, 0.0])


def test_the_integral_of_a_velocity_does_not_wind_up_at_a_barrier(references, config):
    barriers = make_barriers(config, q=Q, highest=[0.5] * 4)
    references.set_gains(0.99, 0.02)
    for _ in range(200):
        track(references, command(dq=1.0), Q, DT)
        references.keep_within(barriers, TRUSTED)
    wanted = references.motors[2].joint_position
    assert abs(wanted - Q[2]) < 0.03
    # So it is followed back at once.
    track(references, command(dq=-1.0), Q, DT)
    assert references.torques(Q, np.zeros(4))[2] < 0.5


def test_at_a_barrier_an_integrated_reference_goes_back_to_the_torque_that_passes(
    references, config
):
    barriers = make_barriers(config, q=Q, highest=[0.5] * 4)
    for _ in range(20):
        track(references, command(dq=0.5), Q, DT)
    assert references.keep_within(barriers, TRUSTED)
    track(references, command(dq=0.5), Q, 0.0)
    assert references.torques(Q, np.zeros(4)) == pytest.approx(0.5)
    # A position is the sender's: it stays where it was asked for.
    track(references, command(q=Q + 0.3), Q, DT)
    assert references.keep_within(barriers, TRUSTED)
    assert get(references, 'joint_position') == pytest.approx(Q + 0.3)


def test_a_boards_integral_counts_as_torque(config, drive):
    references = MotorReferences(config, load_profile('laas_power'), 0.5)
    references.set_gains(5.0, 0.5, 5.0)
    references.set_zero(np.array([0.2, -0.3, 0.4, 0.5]))
    track(references, command(q=Q + 0.1), Q, DT)
    before = references.torques(Q, np.zeros(4))
    references.wind_up(Q, 0.05)
    error = drive.joint_to_motor_velocity(np.full(4, 0.1))
    wound = drive.current_to_effort(5.0 * 0.05 * error)
    after = references.torques(Q, np.zeros(4))
    assert after[1] == pytest.approx(before[1] + wound[1])
    references.wind_up(Q, 100.0)
    assert references.torques(Q, np.zeros(4)) == pytest.approx(config.column('effort_max'))
    # It acts where its gain is, and a board that is off has forgotten it.
    references.damp(np.full(4, np.inf))
    assert references.torques(Q, np.zeros(4)) == pytest.approx(0.0)
    track(references, command(q=Q), Q, DT)
    assert references.torques(Q, np.zeros(4))[1] > 5.0
    references.switch_off()
    track(references, command(q=Q), Q, DT)
    assert references.torques(Q, np.zeros(4)) == pytest.approx(0.0, abs=1e-9)


def test_damping_has_no_stiffness_and_spares_untrusted_encoders(references, config):
    track(references, command(q=Q, tau=1.0), Q, DT)
    references.damp(np.array([np.inf, 0.0, 0.5, np.inf]))
    kd = config.column('board_kd')
    assert get(references, 'kd').tolist() == [kd[0], 0.0, kd[2], kd[3]]
    assert get(references, 'current_max').tolist() == [np.inf, np.inf, 0.5 * kd[2], np.inf]
    assert not get(references, 'kp').any()
    assert not get(references, 'current').any()
    assert not get(references, 'velocity').any()


def test_zero_shifts_positions(references, drive):
    references.set_zero(np.array([1.0, 2.0, 3.0, 4.0]))
    track(references, command(q=Q), Q, DT)
    assert get(references, 'position') == pytest.approx(
        drive.joint_to_motor_position(Q) + [1, 2, 3, 4]
    )
    assert references.torques(Q, np.zeros(4)) == pytest.approx(0.0, abs=1e-9)


def test_a_new_zero_changes_the_joints_angles_and_not_the_motors(references, drive):
    track(references, command(dq=0.0), Q, DT)
    before = get(references, 'position').copy()
    references.set_zero(np.array([10.0, -20.0, 5.0, 0.0]))
    new_q = drive.motor_to_joint_position(before - references.zero)
    assert get(references, 'joint_position') == pytest.approx(new_q)
    track(references, command(dq=0.0), new_q, DT)
    assert get(references, 'position') == pytest.approx(before)


def test_gains_are_set_whole_or_not_at_all(references):
    references.set_gains(2.0, [0.1, 0.2, 0.3, 0.4])
    track(references, command(q=Q), Q, DT)
    assert get(references, 'kp').tolist() == [2.0] * 4
    assert get(references, 'kd').tolist() == [0.1, 0.2, 0.3, 0.4]
    for kp, kd, ki, hint in (
        (5.2, 0.1, 0.0, 'kp .* carry 0 to 5.09'),
        (1.0, 0.7, 0.0, 'kd .* carry 0 to 0.61'),
        (-1.0, 0.1, 0.0, 'kp'),
        (math.nan, 0.1, 0.0, 'kp'),
        ([1.0, 2.0], 0.1, 0.0, 'kp has 2 values: set 1 or 4'),
        (1.0, 0.1, 0.5, 'integral_gain .* carry 0 to 0'),
    ):
        with pytest.raises(ValueError, match=hint):
            references.set_gains(kp, kd, ki)
    track(references, command(q=Q), Q, DT)
    assert get(references, 'kp').tolist() == [2.0] * 4


def test_integral_gain_where_the_frame_carries_it(config):
    references = MotorReferences(config, load_profile('laas_power'), reach_max=0.5)
    references.set_gains(1.0, 0.1, 0.5)
    track(references, command(dq=0.0), Q, DT)
    assert get(references, 'integral_gain').tolist() == [0.5] * 4
    track(references, command(tau=0.0), Q, DT)
    assert not get(references, 'integral_gain').any()
    track(references, command(dq=0.0), Q, DT)
    references.damp(np.full(4, np.inf))
    assert not get(references, 'integral_gain').any()


def test_damping_that_lets_the_arm_fall_is_refused(config):
    references = MotorReferences(config, load_profile(), 0.5, damping_min=[1.0, 3.0, 0.1, 0.1])
    with pytest.raises(
        ValueError, match='kd of joint2 is 0.1 A s/rad, .* set kd to at least 0.1891'
    ):
        references.set_gains(5.0, 0.1)
    with pytest.raises(ValueError, match='kd of joint1 is 0 A s/rad'):
        references.check_gains(0.0, 0.0)
    references.set_gains(0.0, [0.1, 0.2, 0.1, 0.1])
    with pytest.raises(ValueError, match='kd of joint2'):
        MotorReferences(config, load_profile(), 0.5, damping_min=[1.0, 9.0, 0.1, 0.1])


def test_damping_is_checked_after_rounding_to_the_frame(config, coarse_profile):
    # One count of 0.3 A s/rad: 0.14 becomes nothing.
    coarse = coarse_profile('kd', 31.4)
    MotorReferences(replace_kd(config, 0.3), coarse, 0.5, damping_min=0.1)
    with pytest.raises(ValueError, match='a falling arm'):
        MotorReferences(replace_kd(config, 0.14), coarse, 0.5, damping_min=0.1)


def replace_kd(config, kd):
    """Return the configuration with one damping for every joint [A s/rad]."""
    return replace(config, joints=tuple(replace(joint, board_kd=kd) for joint in config.joints))
