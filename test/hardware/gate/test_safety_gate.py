import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.boards.motor_references import MotorReferences
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import CommandBuffer
from aerarm_ros.hardware.gate.joint_barrier import JointLoads
from aerarm_ros.hardware.gate.safety_gate import SafetyGate

Q = np.array([0.0, 1.5, 0.0, 0.0])
DQ = np.zeros(4)
CYCLE = [1e-3] * 4  # [s]
LOSSLESS = [np.nan] * 4, [0] * 4  # no board goes on with an older command


@pytest.fixture
def gate(config, robot):
    return SafetyGate(config, BridgeSettings(), JointLoads(config, robot))


def limit(gate, command, q, dt, now):
    """Return the part of a command within the limits."""
    motors = MotorReferences(load_arm_config(), load_profile(), reach_max=0.5).motors
    gate.follow(command, q, dt, now, motors, [False] * 4)
    out = CommandBuffer(4)
    limiters = gate._joints
    out.q[:] = [limiter.position for limiter in limiters]
    out.dq[:] = [limiter.velocity for limiter in limiters]
    out.tau[:] = [limiter.effort for limiter in limiters]
    return out


def command(**values):
    result = CommandBuffer(4)
    for name, value in values.items():
        getattr(result, name)[:] = value
    return result


def test_at_first_nothing_was_limited(gate):
    assert (gate.last_limited, gate.last_limited_time) == ('', -np.inf)


def test_limits_each_joint_and_counts(gate):
    out = limit(gate, command(dq=[6.0, 1.0, -6.0, 2.0]), Q, 1e-3, now=3.0)
    assert out.dq.tolist() == [5.0, 1.0, -5.0, 2.0]
    assert np.isnan(out.q).all()
    assert gate.limited == {'velocity': 2}
    assert limit(gate, command(q=Q), Q, 1e-3, now=4.0).q.tolist() == Q.tolist()
    assert (gate.last_limited, gate.last_limited_time) == ('velocity', 3.0)
    assert gate.stop == ''


def test_a_violation_latches_and_the_first_reason_stays(gate):
    limit(gate, command(dq=[0.0, 0.0, 0.0, 9.0]), Q, 1e-3, now=3.0)
    reason = gate.stop
    assert 'joint4 was commanded a velocity of 9.00' in reason
    gate.trip('joint2 is at 9.000 rad')
    limit(gate, command(dq=0.0), Q, 1e-3, now=3.0)
    assert gate.stop == reason
    gate.release()
    assert gate.stop == ''


def test_state_is_checked(gate):
    assert gate.state_violation(Q, DQ) == ''
    assert gate.state_violation(Q, np.array([0.0, 0.0, 7.0, 0.0])).startswith('joint3 runs')
    outside = np.array([0.0, 9.0, 0.0, 0.0])
    assert gate.state_violation(outside, DQ).startswith('joint2 is at 9.000 rad')


def test_is_inside_only_with_every_joint(gate):
    assert gate.is_inside(Q)
    assert not gate.is_inside(np.array([0.0, 1.5, 0.0, 2.2]))
    assert not gate.is_inside(np.full(4, np.nan))


def test_motors_align_at_rest_and_inside(gate):
    assert gate.alignment_refusal(Q, DQ) == ''
    assert gate.alignment_refusal(Q, np.array([0.25, -0.25, 0.2, 0.0])) == ''
    assert gate.alignment_refusal(Q, np.array([0.0, -1.234, 0.2, 3.0])) == (
        'joint2 moves at 1.23 rad/s, joint4 moves at 3.00 rad/s: hold the arm, wait until it '
        'rests, then enable it'
    )
    assert gate.alignment_refusal(np.array([0.0, 9.12345, 0.0, 0.0]), DQ) == (
        'joints at [0.    9.123 0.    0.   ] rad are outside their limits: move the arm '
        'back by hand'
    )


def test_an_arm_that_falls_during_alignment_is_stopped(gate):
    gate.watch_alignment(np.array([0.0, 5.0, 0.0, 0.0]))
    assert gate.stop == ''
    gate.watch_alignment(np.array([0.0, -5.01, 0.0, 0.0]))
    assert gate.stop == (
        'joint2 moves at 5.01 rad/s while the motors align: support the arm, and enable again'
    )


def test_the_standstill_command_is_zero_velocity_only():
    still = CommandBuffer.standstill(3)
    assert still.dq.tolist() == [0.0, 0.0, 0.0]
    assert np.isnan(still.q).all()
    assert np.isnan(still.tau).all()


def test_barriers_use_the_posture_and_the_payload(gate):
    stretched, top = np.array([0.0, 0.0, 0.0, 0.0]), np.array([0.0, 1.5, 0.0, 2.094])
    gate.watch(stretched, DQ, np.array([0.0, 5.4, 0.0, 0.0]), CYCLE, CYCLE, *LOSSLESS)
    assert gate.barriers[1].load == pytest.approx(5.3, abs=0.2)
    assert gate.barriers[1].highest > 9.39
    gate.watch(top, DQ, DQ, CYCLE, CYCLE, *LOSSLESS)
    assert abs(gate.barriers[3].highest) < 0.5
    assert gate.barriers[3].lowest < -9.39


def test_others_are_slowed_while_a_joint_cannot_be_braked(gate):
    # Joint 1 at full speed throws the stretched arm outward, towards the limit of joint 2.
    q, fast = np.array([0.0, -0.3, 0.0, 0.0]), np.array([5.0, -4.0, 5.0, 5.0])
    free = [barrier.speed(2.0) for barrier in gate.barriers]
    for _ in range(20):
        gate.watch(q, fast, DQ, CYCLE, CYCLE, *LOSSLESS)
    slowed = [barrier.speed(2.0) for barrier in gate.barriers]
    assert gate.barriers[1].is_overwhelmed
    assert slowed[1] == free[1]
    assert (np.array(slowed)[[0, 2, 3]] < 0.96 * np.array(free)[[0, 2, 3]]).all()
    assert limit(gate, command(dq=5.0), Q, 1e-3, now=0.0).dq[0] < 4.9
    gate.watch(q, fast, DQ, CYCLE, [6e-3] * 4, *LOSSLESS)  # after a pause nobody knows
    assert [barrier.speed(2.0) for barrier in gate.barriers] == slowed
    for _ in range(100):
        gate.watch(Q, DQ, DQ, CYCLE, CYCLE, *LOSSLESS)
    assert [barrier.speed(2.0) for barrier in gate.barriers] == free
    assert not any(barrier.is_slowed for barrier in gate.barriers)


def test_braking_is_counted(gate):
    gate.note_braking(2.0)
    assert gate.limited == {'braking': 1}
    assert (gate.last_limited, gate.last_limited_time) == ('braking', 2.0)


def test_restart_forgets_the_effort(gate):
    for _ in range(10):
        limit(gate, command(tau=5.0), Q, 1e-3, now=0.0)
    gate.restart()
    out = limit(gate, command(tau=5.0), Q, 1e-3, now=0.0)
    assert out.tau == pytest.approx([1.0, 1.0, 0.5, 0.5])


def test_barriers_receive_the_measurements_of_their_joints(gate, config, robot):
    others = SafetyGate(config, BridgeSettings(), JointLoads(config, robot)).barriers
    effort, kept = np.array([1.0, 2.0, 3.0, 4.0]), [5.0, 6.0, 7.0, 8.0]
    ages, intervals, unconfirmed = [1e-3, 2e-3, 3e-3, 4e-3], [1e-3, 1e-3, 2e-3, 2e-3], [0, 1, 2, 3]
    for speed in (0.1, 0.2):
        gate.watch(Q, DQ + speed, effort, ages, intervals, kept, unconfirmed)
        for i, other in enumerate(others):
            load, inertia, times = gate.loads[i], gate.inertias[i], (ages[i], intervals[i])
            was_kept = unconfirmed[i] > 1
            other.update(Q[i], speed, effort[i], load, inertia, *times, kept[i], was_kept)
            for name in ('q', 'dq', 'filtered', 'load', 'lowest', 'highest'):
                assert getattr(gate.barriers[i], name) == getattr(other, name), (i, name)


def test_a_followed_command_is_braked_at_the_barriers_of_trusted_joints(gate):
    motors = MotorReferences(load_arm_config(), load_profile(), reach_max=0.5).motors
    for barrier in gate.barriers:
        barrier.q, barrier.lowest, barrier.highest = 0.0, -9.0, 9.0
    given = (command(tau=0.4), Q, 1e-3, 0.0, motors)
    assert gate.follow(*given, [True] * 4) is False
    assert [motor.torque(0.0, 0.0) for motor in motors] == pytest.approx([0.4] * 4)
    gate.barriers[1].highest = gate.barriers[2].highest = 0.1
    assert gate.follow(*given, [True, True, False, True]) is True
    assert [motor.torque(0.0, 0.0) for motor in motors] == pytest.approx([0.4, 0.1, 0.4, 0.4])
    gate.trip('a stop')
    assert gate.follow(command(tau=0.0), *given[1:], [True] * 4) is False
    assert motors[0].torque(0.0, 0.0) == pytest.approx(0.4)  # the caller damps it


def test_a_warm_motor_limits_the_effort_of_its_joint(gate):
    gate.limit_effort(1, 1.5)
    for _ in range(50):
        out = limit(gate, command(tau=5.0), Q, 1e-3, now=0.0)
    assert out.tau == pytest.approx([5.0, 1.5, 5.0, 5.0])
