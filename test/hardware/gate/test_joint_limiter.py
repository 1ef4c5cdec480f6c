import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier
from aerarm_ros.hardware.gate.safety_gate import JointLimiter

JOINT = load_arm_config().joints[2]  # +-2.967 rad, 5 rad/s, 7.69 Nm, 500 Nm/s
SETTINGS = BridgeSettings()
NAN = math.nan
DT = 1e-3


def make_limiter():
    return JointLimiter(JOINT, SETTINGS, JointBarrier(JOINT, SETTINGS, 20.0, 0.012))


def limited(position=NAN, velocity=NAN, effort=NAN, q=0.0, cycles=1):
    limiter = make_limiter()
    for _ in range(cycles):
        limiter.limit(position, velocity, effort, q, DT)
    return limiter


def test_references_within_the_limits_pass_unchanged():
    limiter = limited(position=0.001, velocity=1.0, effort=0.2)
    assert (limiter.position, limiter.velocity, limiter.effort) == (0.001, 1.0, 0.2)
    assert limiter.limited == []


def test_at_its_limit_a_reference_still_moves_slowly():
    # Else it would never reach the limit.
    assert limited(velocity=5.0, q=JOINT.position_max).velocity == pytest.approx(0.025)
    assert limited(velocity=-5.0, q=JOINT.position_min).velocity == pytest.approx(-0.025)


def test_unused_stays_unused():
    fresh = make_limiter()
    assert all(map(math.isnan, (fresh.position, fresh.velocity, fresh.effort)))
    limiter = limited()
    assert all(map(math.isnan, (limiter.position, limiter.velocity, limiter.effort)))


def test_position_is_held_at_its_limit():
    limiter = limited(position=2.99, q=2.966, cycles=100)
    assert limiter.position == JOINT.position_max
    assert 'position' in limiter.limited


def test_a_step_of_position_is_led_at_the_velocity_limit():
    limiter = make_limiter()
    for cycle in range(1, 11):
        limiter.limit(0.3, NAN, NAN, 0.0, DT)
        assert limiter.position == pytest.approx(5.0 * DT * cycle)
        assert limiter.limited == ['velocity']
    limiter.restart()
    limiter.limit(0.3, NAN, NAN, 0.2, DT)
    assert limiter.position == pytest.approx(0.205)


def test_velocity_is_cut_to_its_limit():
    assert limited(velocity=6.0).velocity == 5.0
    assert limited(velocity=-6.0).velocity == -5.0
    assert limited(velocity=6.0).limited == ['velocity']


@pytest.mark.parametrize('distance', [0.0, 0.01, 0.05, 0.1, 0.3, 0.9])
def test_speed_towards_a_limit_is_limited_to_the_brakeable_speed(distance):
    q = JOINT.position_max - distance
    fastest = limited(velocity=5.0, q=q).velocity
    assert fastest**2 / 2.0 / 20.0 <= distance + 1e-4
    assert fastest >= min(0.8 * make_limiter().barrier.speed(distance), 4.9)
    assert limited(velocity=-5.0, q=q).velocity == -5.0
    assert limited(velocity=-5.0, q=-q).velocity == -fastest
    assert ('soft_zone' in limited(velocity=5.0, q=q).limited) == (distance < 0.9)


def test_a_position_that_runs_into_its_limit_slows_down_before():
    limiter = make_limiter()
    path = []
    for _ in range(2000):
        limiter.limit(2.99, NAN, NAN, 2.0, DT)
        path.append(limiter.position)
    speeds = [(after - before) / DT for before, after in pairwise([2.0, *path])]
    assert max(speeds) == pytest.approx(5.0)
    assert path[-1] == JOINT.position_max
    fall = min(after - before for before, after in pairwise(speeds)) / DT
    assert fall == pytest.approx(-20.0, rel=0.15)
    # Away from the limit nothing slows it.
    limiter.limit(2.0, NAN, NAN, 2.0, DT)
    assert limiter.position == pytest.approx(JOINT.position_max - 5.0 * DT)


def test_effort_is_cut_and_slowed():
    limiter = limited(effort=9.0, cycles=100)
    assert limiter.effort == 7.69
    assert limiter.limited == ['effort']
    limiter = make_limiter()
    efforts = []
    for _ in range(5):
        limiter.limit(NAN, NAN, 3.0, 0.0, DT)
        efforts.append(limiter.effort)
    assert efforts == pytest.approx([0.5, 1.0, 1.5, 2.0, 2.5])
    assert limiter.limited == ['effort_rate']
    limiter.limit(NAN, 0.0, NAN, 0.0, DT)
    limiter.limit(NAN, NAN, 3.0, 0.0, DT)
    assert limiter.effort == pytest.approx(0.5)


FINITE = st.floats(-1e3, 1e3)
MAYBE = st.one_of(st.just(NAN), FINITE)


@given(st.lists(st.tuples(MAYBE, MAYBE, MAYBE, st.floats(-4, 4)), max_size=20))
def test_nothing_gets_past_the_limits(requests):
    limiter = make_limiter()
    effort = 0.0
    for position, velocity, wanted, q in requests:
        limiter.limit(position, velocity, wanted, q, DT)
        for value, request in (
            (limiter.position, position),
            (limiter.velocity, velocity),
            (limiter.effort, wanted),
        ):
            assert math.isnan(value) == math.isnan(request)
        assert not abs(limiter.velocity) > 5.0
        assert not abs(limiter.effort) > 7.69
        assert not abs(limiter.effort - effort) > 0.5 + 1e-9
        effort = 0.0 if math.isnan(limiter.effort) else limiter.effort


@pytest.mark.parametrize(
    ('q', 'dq', 'hint'),
    [
        (3.02, 0.0, 'joint3 is at 3.020 rad'),
        (-3.02, 0.0, 'outside its limits'),
        (0.0, 6.3, 'runs at 6.30'),
        (0.0, -6.3, 'encoder'),
        (NAN, 0.0, 'joint3 is at nan'),
        (0.0, NAN, 'runs at nan'),
    ],
)
def test_a_joint_out_of_bounds_demands_a_stop(q, dq, hint):
    assert hint in make_limiter().state_violation(q, dq)


def test_the_reason_for_a_stop_is_one_complete_sentence():
    assert make_limiter().state_violation(3.02, 0.0) == (
        'joint3 is at 3.020 rad, outside its limits -2.967 to 2.967: disable the arm, move it back '
        'by hand, then clear the fault'
    )
    assert make_limiter().state_violation(0.0, 6.3) == (
        'joint3 runs at 6.30 rad/s, above its limit of 5.00: check the controller and the encoder'
    )


def test_a_joint_within_tolerance_requires_no_stop():
    limiter = make_limiter()
    assert limiter.state_violation(3.01, 6.2) == ''
    assert limiter.state_violation(-3.01, -6.2) == ''


@pytest.mark.parametrize(
    ('command', 'hint'),
    [
        ((3.1, NAN, NAN), 'outside its limits'),
        ((0.6, NAN, NAN), 'too far for one step'),
        ((NAN, 6.3, NAN), 'velocity of 6.30'),
        ((NAN, NAN, -15.5), 'effort of -15.50'),
    ],
)
def test_a_command_far_out_of_bounds_demands_a_stop(command, hint):
    limiter = make_limiter()
    assert hint in limiter.command_violation(*command, q=0.0)
    assert 'joint3' in limiter.command_violation(*command, q=0.0)


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_the_arm_stops_beyond_its_tolerances_and_not_at_them(way):
    limiter = make_limiter()
    end = way * (JOINT.position_max + SETTINGS.position_tolerance)
    fastest = way * SETTINGS.velocity_factor * JOINT.velocity_max
    strongest = way * SETTINGS.effort_factor * JOINT.effort_max
    assert limiter.is_inside(end)
    assert not limiter.is_inside(math.nextafter(end, way * math.inf))
    assert limiter.state_violation(end, fastest) == ''
    assert limiter.state_violation(end, math.nextafter(fastest, way * math.inf))
    assert limiter.state_violation(math.nextafter(end, way * math.inf), fastest)
    reach = way * SETTINGS.position_error_max
    assert limiter.command_violation(reach, fastest, strongest, q=0.0) == ''
    assert limiter.command_violation(NAN, NAN, math.nextafter(strongest, way * math.inf), q=0.0)


def test_a_command_slightly_above_its_limits_requires_no_stop():
    limiter = make_limiter()
    assert limiter.command_violation(3.0, 6.2, 15.0, q=2.9) == ''
    assert limiter.command_violation(NAN, NAN, NAN, q=0.0) == ''


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_a_position_in_the_soft_zone_is_led_at_the_speed_of_the_barrier(side):
    start = side * (JOINT.position_max - 0.05)
    limiter = limited(position=side * JOINT.position_max, q=start)
    slowest, fastest = limiter._speeds(start)
    bound = fastest if side > 0.0 else slowest
    assert 0.0 < abs(bound) < JOINT.velocity_max
    assert limiter.position == pytest.approx(start + bound * DT, abs=1e-12)
    assert limiter.limited[-1] == 'soft_zone'


def test_each_limit_is_reported_once_by_name():
    limiter = limited(position=9.0, velocity=9.0, effort=99.0, q=JOINT.position_max - 0.01)
    assert set(limiter.limited) == {'position', 'velocity', 'soft_zone', 'effort', 'effort_rate'}
    assert limited(velocity=JOINT.velocity_max).limited == []
    assert limited(velocity=-1.001 * JOINT.velocity_max).limited == ['velocity']
    assert limited(effort=0.4).limited == []
    assert limited(effort=-0.6).limited == ['effort_rate']
