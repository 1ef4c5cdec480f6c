import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_limiter import JointLimiter

JOINT = load_arm_config().joints[2]  # +-2.967 rad, 5 rad/s, 7.69 Nm, 500 Nm/s
SETTINGS = BridgeSettings()
NAN = math.nan
DT = 1e-3


def limited(position=NAN, velocity=NAN, effort=NAN, q=0.0, dq=0.0, cycles=1):
    limiter = JointLimiter(JOINT, SETTINGS)
    for _ in range(cycles):
        limiter.limit(position, velocity, effort, q, dq, DT)
    return limiter


def test_what_is_allowed_passes_unchanged():
    limiter = limited(position=0.001, velocity=1.0, effort=0.2)
    assert (limiter.position, limiter.velocity, limiter.effort) == (0.001, 1.0, 0.2)
    assert limiter.limited == []
    assert math.isnan(limiter.brake)


def test_unused_stays_unused():
    limiter = limited()
    assert all(map(math.isnan, (limiter.position, limiter.velocity, limiter.effort)))


def test_position_is_held_at_its_limit():
    limiter = limited(position=2.99, q=2.966, cycles=10)
    assert limiter.position == JOINT.position_max
    assert 'position' in limiter.limited


def test_a_step_of_position_is_led_at_the_velocity_limit():
    limiter = JointLimiter(JOINT, SETTINGS)
    for cycle in range(1, 11):
        limiter.limit(0.3, NAN, NAN, 0.0, 0.0, DT)
        assert limiter.position == pytest.approx(5.0 * DT * cycle)
        assert limiter.limited == ['velocity']
    limiter.restart()
    limiter.limit(0.3, NAN, NAN, 0.2, 0.0, DT)
    assert limiter.position == pytest.approx(0.205)


def test_velocity_is_cut_to_its_limit():
    assert limited(velocity=6.0).velocity == 5.0
    assert limited(velocity=-6.0).velocity == -5.0
    assert limited(velocity=6.0).limited == ['velocity']


@pytest.mark.parametrize(('q', 'share'), [(2.867, 1.0), (2.917, 0.5), (2.967, 0.0), (3.0, 0.0)])
def test_in_the_soft_zone_speed_towards_the_limit_falls_to_zero(q, share):
    assert limited(velocity=5.0, q=q).velocity == pytest.approx(5.0 * share, abs=1e-9)
    assert limited(velocity=-5.0, q=q).velocity == -5.0
    assert limited(velocity=-5.0, q=-q).velocity == pytest.approx(-5.0 * share, abs=1e-9)


def test_in_the_soft_zone_effort_towards_the_limit_falls_to_zero():
    limiter = limited(effort=7.0, q=2.917, cycles=50)
    assert limiter.effort == pytest.approx(0.5 * 7.69)
    assert 'soft_zone' in limiter.limited
    assert limited(effort=-7.0, q=2.917, cycles=50).effort == -7.0
    # With a position reference the law itself holds the joint inside.
    assert limited(position=2.9, effort=7.0, q=2.917, cycles=50).effort == 7.0


def test_torque_control_is_braked_where_it_is_too_fast():
    assert limited(effort=1.0, dq=6.0).brake == 5.0
    assert limited(effort=1.0, dq=-6.0).brake == -5.0
    assert limited(effort=1.0, q=2.917, dq=4.0).brake == pytest.approx(2.5)
    assert limited(effort=1.0, q=3.0, dq=0.5).brake == 0.0
    assert math.isnan(limited(effort=1.0, q=3.0, dq=-0.5).brake)
    assert math.isnan(limited(velocity=1.0, effort=1.0, dq=6.0).brake)


def test_effort_is_cut_and_slowed():
    limiter = limited(effort=9.0, cycles=100)
    assert limiter.effort == 7.69
    assert limiter.limited == ['effort']
    limiter = JointLimiter(JOINT, SETTINGS)
    efforts = []
    for _ in range(5):
        limiter.limit(NAN, NAN, 3.0, 0.0, 0.0, DT)
        efforts.append(limiter.effort)
    assert efforts == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5])
    assert limiter.limited == ['effort_rate']
    limiter.limit(NAN, 0.0, NAN, 0.0, 0.0, DT)
    limiter.limit(NAN, NAN, 3.0, 0.0, 0.0, DT)
    assert limiter.effort == pytest.approx(0.5)


FINITE = st.floats(-1e3, 1e3)
MAYBE = st.one_of(st.just(NAN), FINITE)


@given(st.lists(st.tuples(MAYBE, MAYBE, MAYBE, st.floats(-4, 4), FINITE), max_size=20))
def test_nothing_gets_past_the_limits(requests):
    limiter = JointLimiter(JOINT, SETTINGS)
    effort = 0.0
    for position, velocity, wanted, q, dq in requests:
        limiter.limit(position, velocity, wanted, q, dq, DT)
        for value, request in (
            (limiter.position, position),
            (limiter.velocity, velocity),
            (limiter.effort, wanted),
        ):
            assert math.isnan(value) == math.isnan(request)
        assert not abs(limiter.velocity) > 5.0
        assert not abs(limiter.effort) > 7.69
        assert not abs(limiter.effort - effort) > 0.5 + 1e-9
        assert not abs(limiter.brake) > 5.0
        effort = 0.0 if math.isnan(limiter.effort) else limiter.effort


@pytest.mark.parametrize(
    ('q', 'dq', 'hint'),
    [
        (3.02, 0.0, 'joint3 is at 3.020 rad'),
        (-3.02, 0.0, 'beyond its limits'),
        (0.0, 6.3, 'runs at 6.30'),
        (0.0, -6.3, 'encoder'),
        (NAN, 0.0, 'joint3 is at nan'),
        (0.0, NAN, 'runs at nan'),
    ],
)
def test_a_joint_out_of_bounds_demands_a_stop(q, dq, hint):
    assert hint in JointLimiter(JOINT, SETTINGS).state_violation(q, dq)


def test_a_joint_within_tolerance_demands_none():
    limiter = JointLimiter(JOINT, SETTINGS)
    assert limiter.state_violation(3.01, 6.2) == ''
    assert limiter.state_violation(-3.01, -6.2) == ''


@pytest.mark.parametrize(
    ('command', 'hint'),
    [
        ((3.1, NAN, NAN), 'beyond its limits'),
        ((0.6, NAN, NAN), 'too far for one step'),
        ((NAN, 6.3, NAN), 'velocity of 6.30'),
        ((NAN, NAN, -15.5), 'effort of -15.50'),
    ],
)
def test_a_command_far_out_of_bounds_demands_a_stop(command, hint):
    limiter = JointLimiter(JOINT, SETTINGS)
    assert hint in limiter.command_violation(*command, q=0.0)
    assert 'joint3' in limiter.command_violation(*command, q=0.0)


def test_a_command_a_little_over_its_limits_demands_none():
    limiter = JointLimiter(JOINT, SETTINGS)
    assert limiter.command_violation(3.0, 6.2, 15.0, q=2.9) == ''
    assert limiter.command_violation(NAN, NAN, NAN, q=0.0) == ''
