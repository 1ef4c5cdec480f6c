import math

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier

JOINT = load_arm_config().joints[3]  # +-2.094 rad, 5 rad/s, 9.39 Nm
SETTINGS = BridgeSettings()
INERTIA = 0.01  # [kg m^2]
DECELERATION = 60.0
DT = 1e-3


def make_barrier(settings=SETTINGS):
    return JointBarrier(JOINT, settings, DECELERATION, INERTIA)


def seen(q=0.0, dq=0.0, effort=0.0, load=0.0):
    """Return a barrier that has processed some cycles of a joint's motion."""
    barrier = make_barrier()
    for _ in range(30):
        barrier.update(q, dq, effort, load, INERTIA, DT, DT)
    return barrier


def test_the_speed_is_one_that_stops_within_the_distance():
    barrier = make_barrier()
    for distance in np.linspace(1e-3, 1.0, 50):
        assert barrier.speed(distance) ** 2 / (2.0 * DECELERATION) <= distance
    assert barrier.speed(0.0) == 0.0
    assert barrier.speed(0.1) > 0.9 * math.sqrt(2.0 * DECELERATION * 0.1)
    assert JOINT.velocity_max < barrier.speed(1.0) < 1.1 * JOINT.velocity_max


def test_the_speed_falls_steadily_and_leads_back_slowly():
    barrier = make_barrier()
    speeds = [barrier.speed(distance) for distance in np.linspace(-0.2, 0.5, 701)]
    steps = np.diff(speeds)
    assert (steps >= 0.0).all()
    assert steps.max() < 0.06
    assert min(speeds) == pytest.approx(-0.25)


def test_far_from_limits_every_torque_passes():
    for speed in (-2.5, 0.0, 1.0):
        barrier = seen(dq=speed)
        assert barrier.highest > JOINT.effort_max or speed > 0.0
        assert barrier.lowest < -JOINT.effort_max or speed < 0.0
        assert barrier.lowest < -2.0 < 2.0 < barrier.highest


def test_torque_towards_a_limit_closes_before_it_and_opens_back():
    near = seen(q=JOINT.position_max - 0.02, dq=1.0)
    assert near.highest < 1.0
    assert near.lowest < -JOINT.effort_max
    beyond = seen(q=JOINT.position_max + 0.01)
    assert beyond.highest < -0.5
    other = seen(q=-JOINT.position_max - 0.01)
    assert other.lowest == pytest.approx(-beyond.highest)


def test_on_the_barrier_the_torque_bound_brakes_along_it():
    q = JOINT.position_max - 0.1
    speed = make_barrier().speed(0.1 - DT * 3.4)
    barrier = seen(q=q, dq=speed, effort=1.0, load=1.0)
    assert barrier.highest == pytest.approx(1.0 - INERTIA * DECELERATION, abs=0.2)


def test_torque_closes_as_the_speed_comes_near_its_limit():
    bounds = [seen(dq=speed).highest for speed in (1.0, 3.0, 4.5, 5.0, 5.5)]
    assert (np.diff(bounds) < 0.0).all()
    assert bounds[0] > JOINT.effort_max
    assert bounds[2] < 3.0
    assert bounds[4] < -0.2


def test_the_boards_low_pass_is_looked_through():
    # A joint that accelerates evenly: the filtered speed lags, the predicted one does not.
    barrier, rate, speed, filtered = make_barrier(), 400.0, 0.0, 0.0
    kept = math.exp(-DT / SETTINGS.velocity_lag)
    for cycle in range(12):
        barrier.update(0.0, filtered, rate * INERTIA, 0.0, INERTIA, DT, DT)
        if cycle > 2:
            assert barrier.dq == pytest.approx(speed + rate * DT, abs=0.02)
            assert barrier.dq - filtered > 0.8
        for _ in range(100):
            speed += rate * DT / 100.0
            filtered += (1.0 - kept ** (1 / 100)) * (speed - filtered)


def test_an_unknown_load_is_learned_from_the_motion():
    # 0.5 Nm more than known holds the joint still against 0.5 Nm of torque.
    barrier = seen(effort=0.5, load=0.0)
    assert barrier.load == pytest.approx(0.5, abs=0.02)
    barrier.restart()
    barrier.update(0.0, 0.0, 0.5, 0.0, INERTIA, DT, DT)
    assert barrier.load == 0.0


def test_the_learned_load_is_bounded():
    assert seen(effort=9.0, load=0.0).load == pytest.approx(0.15 * JOINT.effort_max)
    assert seen(dq=4.0, effort=99.0).load == pytest.approx(2.15 * JOINT.effort_max)
    assert seen(dq=-4.0, effort=-99.0).load == pytest.approx(-2.15 * JOINT.effort_max)


def test_of_a_fast_joint_more_is_learned_which_fades_when_it_is_slow():
    """On an inverted base the load is 6 Nm below the model, of which 1.4 are always learnt."""
    barrier = make_barrier()
    for _ in range(100):  # 6 Nm of torque on 0 of load, and it does not get faster
        barrier.update(0.0, 4.0, 6.0, 0.0, INERTIA, DT, DT)
    assert barrier.load == pytest.approx(6.0, abs=0.3)
    assert barrier.highest == pytest.approx(6.0 + 250.0 * INERTIA * (5.25 - 4.0), abs=0.4)
    loads = []
    for _ in range(100):
        barrier.update(0.0, 1.0, 6.0, 0.0, INERTIA, DT, DT)
        loads.append(barrier.load)
    assert loads[-1] == pytest.approx(0.15 * JOINT.effort_max, abs=0.2)
    assert loads[20] - loads[-1] > 1.0
    assert loads[20] - loads[-1] == pytest.approx(2.0 * (loads[41] - loads[-1]), rel=0.15)


def test_a_pause_teaches_nothing_and_is_looked_beyond():
    barrier = seen(dq=2.0)
    barrier.update(0.0, 1.0, 0.0, 0.0, INERTIA, DT, 0.02)
    assert barrier.load == pytest.approx(0.0, abs=1e-6)
    assert barrier.dq == pytest.approx(1.0)
    barrier.update(0.0, 1.0, 0.0, 0.0, INERTIA, 0.02, DT)
    assert barrier.q == pytest.approx(0.02)


def test_speeds_are_compared_over_the_time_between_them():
    # 400 rad/s^2, as commanded, seen over intervals of a host that is held up.
    barrier, rate, speed, filtered = make_barrier(), 400.0, 0.0, 0.0
    for interval in (1e-3, 1e-3, 1.8e-3, 0.3e-3, 1e-3, 3e-3, 0.5e-3):
        kept = math.exp(-interval / 1000 / SETTINGS.velocity_lag)
        for _ in range(1000):
            speed += rate * interval / 1000
            filtered += (1.0 - kept) * (speed - filtered)
        barrier.update(0.0, filtered, rate * INERTIA, 0.0, INERTIA, DT, interval)
    assert barrier.load == pytest.approx(0.0, abs=0.15)


def test_an_answer_that_is_missing_makes_the_last_one_older():
    barrier = seen(dq=1.0)
    barrier.update(0.0, 1.0, 1.0, 0.0, INERTIA, 3.0 * DT, 0.0)
    assert barrier.dq == pytest.approx(1.0 + 3.0 * DT * 1.0 / INERTIA)
    assert barrier.load == 0.0


def test_nothing_is_slowed_from_far_on_and_everything_below():
    wide = BridgeSettings(soft_zone=1.0)  # slows more than braking needs, all the way
    for settings, deceleration in ((SETTINGS, 60.0), (SETTINGS, 4.0), (wide, 60.0), (wide, 10.0)):
        barrier = JointBarrier(JOINT, settings, deceleration, INERTIA)
        fastest = 1.05 * JOINT.velocity_max
        assert barrier.speed(barrier.far) == pytest.approx(fastest)
        assert barrier.speed(2.0 * barrier.far) == pytest.approx(fastest)
        assert barrier.speed(0.999 * barrier.far) < fastest
        assert barrier.speed(0.999 * barrier.far) > 0.98 * fastest


def test_before_the_first_cycle_nothing_is_known():
    barrier = make_barrier()
    assert (barrier.q, barrier.dq, barrier.filtered, barrier.load) == (0.0, 0.0, 0.0, 0.0)
    assert (barrier.noise, barrier.lowest, barrier.highest) == (0.0, 0.0, 0.0)


def test_the_place_is_led_on_with_speed_and_acceleration():
    barrier = make_barrier()
    barrier.update(0.5, 2.0, 3.0, 1.0, INERTIA, 2.0 * DT, DT)
    time, acceleration = 2.0 * DT, 2.0 / INERTIA
    assert barrier.q == pytest.approx(0.5 + time * 2.0 + 0.5 * acceleration * time**2)
    assert barrier.dq == pytest.approx(2.0 + time * acceleration)


def test_the_predicted_filtered_speed_lags_behind_the_speed():
    barrier = make_barrier()
    barrier.update(0.0, 2.0, 3.0, 1.0, INERTIA, DT, DT)
    mean = 2.0 + 0.5 * DT * 2.0 / INERTIA
    kept = math.exp(-DT / SETTINGS.velocity_lag)
    assert barrier.filtered == pytest.approx(kept * 2.0 + (1.0 - kept) * mean)
    assert 2.0 < barrier.filtered < mean


@pytest.mark.parametrize(('inertia', 'gain'), [(0.01, 2.5), (0.02, 5.0), (1.0, 2.0 * 9.39)])
def test_torque_falls_with_speed_beyond_the_barrier_as_fast_as_delay_and_drive_allow(inertia, gain):
    def highest(speed):
        barrier = JointBarrier(JOINT, SETTINGS, DECELERATION, inertia)
        barrier.update(0.0, speed, 0.0, 0.0, inertia, DT, DT)
        assert barrier.noise == pytest.approx(0.15 * gain, rel=1e-2)
        return barrier.highest

    # Far from the limits nothing but the speed limit counts.
    assert highest(4.0) - highest(5.0) == pytest.approx(gain, rel=1e-2)
    assert highest(5.25) == pytest.approx(0.0, abs=1e-9)
    assert highest(-1.0) == pytest.approx(6.25 * gain, rel=1e-2)


def test_a_joint_that_leaves_a_limit_is_not_braked_by_it():
    q = JOINT.position_max - 0.02
    leaving, resting = seen(q=q, dq=-1.0), seen(q=q)
    gain = 250.0 * INERTIA
    assert leaving.highest == pytest.approx(gain * (leaving.speed(0.02 + DT) + 1.0), rel=0.01)
    assert resting.highest == pytest.approx(gain * resting.speed(0.02))
    mirrored = seen(q=-q, dq=1.0)
    assert mirrored.lowest == pytest.approx(-leaving.highest)


def test_towards_either_limit_the_torque_brakes_with_the_slope_of_the_barrier():
    for distance in (0.005, 0.05, 0.15):
        near = seen(q=JOINT.position_max - distance, dq=0.5)
        left = distance - DT * 0.5
        slope = (near.speed(left + 1e-6) - near.speed(left - 1e-6)) / 2e-6
        brake = 250.0 * INERTIA * (near.speed(left) - 0.5) - INERTIA * slope * 0.5
        assert near.highest == pytest.approx(brake, rel=1e-3)
        other = seen(q=distance - JOINT.position_max, dq=-0.5)
        assert other.lowest == pytest.approx(-near.highest)


def test_a_load_is_learned_with_a_time_constant_of_five_milliseconds():
    barrier = make_barrier()
    barrier.update(0.0, 0.0, 0.5, 0.0, INERTIA, DT, math.inf)
    barrier.update(0.0, 0.0, 0.5, 0.0, INERTIA, DT, DT)
    first = barrier.load
    barrier.update(0.0, 0.0, 0.5, 0.0, INERTIA, DT, DT)
    assert 0.0 < first < 0.5
    # What is missing falls by the same share each time.
    assert (0.5 - barrier.load) / (0.5 - first) == pytest.approx(5.0 / 6.0, abs=0.06)


def test_speeds_five_milliseconds_apart_still_teach():
    barrier = seen(effort=0.5)
    learned = barrier.load
    barrier.update(0.0, 0.0, 0.7, 0.0, INERTIA, DT, 5e-3)
    assert barrier.load != learned


def test_estimates_from_before_a_restart_are_not_used():
    barrier, fresh = seen(dq=3.0, effort=2.0, load=1.0), make_barrier()
    barrier.restart()
    for each in (barrier, fresh):
        each.update(0.1, 1.0, 0.5, 0.2, INERTIA, DT, DT)
    assert (barrier.q, barrier.dq) == pytest.approx((fresh.q, fresh.dq))
    assert (barrier.load, barrier.highest) == pytest.approx((fresh.load, fresh.highest))


def test_a_slowed_joint_is_limited_to_a_fraction_of_its_speed_and_recovers():
    barrier = make_barrier()
    fastest = barrier.speed(2.0)
    assert not barrier.is_slowed
    speeds = []
    for _ in range(400):
        barrier.lower_speed_limit(DT)
        speeds.append(barrier.speed(2.0))
    assert speeds[0] == pytest.approx(fastest * (1.0 - DT / 0.3))
    assert speeds[-1] == pytest.approx(0.3 * fastest)
    assert barrier.is_slowed
    for _ in range(690):
        barrier.recover(DT)
    assert barrier.is_slowed
    for _ in range(20):
        barrier.recover(DT)
    assert not barrier.is_slowed
    assert barrier.speed(2.0) == fastest
    barrier.lower_speed_limit(0.1)
    barrier.restart()
    assert barrier.speed(2.0) == fastest


def test_a_slowed_joint_is_braked_far_from_its_limits():
    slowed, free = make_barrier(), make_barrier()
    slowed.lower_speed_limit(0.15)
    for barrier in (slowed, free):
        barrier.update(0.0, 4.0, 0.0, 0.0, INERTIA, DT, DT)
    assert slowed.highest < -2.0
    assert free.highest > 0.0


def test_a_joint_is_overwhelmed_if_full_torque_cannot_brake_it():
    near = JOINT.position_max - 0.1
    # 60 rad/s^2 leave 8.8 Nm for a load.
    assert not seen(q=near, dq=3.0, load=-8.0).is_overwhelmed
    assert seen(q=near, dq=3.0, load=10.5).is_overwhelmed is False
    pulled = seen(q=near, dq=4.5, load=-12.0)
    assert pulled.is_overwhelmed
    assert seen(q=-near, dq=-4.5, load=12.0).is_overwhelmed
    assert not seen(q=0.0, dq=3.0, load=-8.0).is_overwhelmed


PULL = 0.05 * JOINT.effort_max  # of other joints that are braked meanwhile


def test_a_torque_that_is_safe_during_a_host_delay_needs_no_damping():
    # Until the board lets go it brings the joint to 1.1 times its limit at most, and to 1.15 times
    # if other joints pull at it.
    barrier = seen()
    per_speed = JOINT.velocity_max * INERTIA / SETTINGS.board_timeout
    most = min(1.1 * per_speed, 1.15 * per_speed - PULL)
    assert barrier.gap_damping(0.99 * most) == barrier.gap_damping(-0.99 * most) == 0.0
    assert barrier.gap_damping(1.01 * most) > 0.0 < barrier.gap_damping(-1.01 * most)
    loaded = seen(effort=2.0, load=2.0)
    assert loaded.gap_damping(2.0 + 0.99 * most) == 0.0 < loaded.gap_damping(2.0 - 1.01 * most)


@pytest.mark.parametrize('speed', [0.0, 2.0, 4.0])
def test_more_torque_ends_by_its_damping_at_little_more_than_the_speed_limit(speed):
    barrier = seen(dq=speed)
    damping = barrier.gap_damping(5.0)
    at_end, pulled = (speed + torque / damping for torque in (5.0, 5.0 + PULL))
    if damping < 700.0 * INERTIA:
        most = max(at_end / 1.1, pulled / 1.15)
        assert most == pytest.approx(JOINT.velocity_max, abs=1e-3)
    assert at_end < 1.2 * JOINT.velocity_max
    assert seen(dq=-speed).gap_damping(-5.0) == pytest.approx(damping)
    # Braking needs none.
    assert seen(dq=-4.5).gap_damping(5.0) < damping


def test_no_damping_is_more_than_a_low_passed_speed_allows():
    assert seen(dq=JOINT.velocity_max).gap_damping(9.0) == pytest.approx(700.0 * INERTIA)
    assert seen(dq=2.0 * JOINT.velocity_max).gap_damping(0.5) == pytest.approx((0.5 + PULL) / 0.25)


@pytest.mark.parametrize('period', [0.5e-3, 1e-3, 4e-3])
def test_the_mean_of_the_boards_speed_is_that_of_its_low_pass(period):
    barrier = make_barrier(BridgeSettings(period=period))
    barrier.dq, barrier.filtered, barrier.load = 1.0, 0.4, 0.5
    torque, filtered, speed, total = 2.0, 0.4, 1.0, 0.0
    step = period / 1000.0
    for _ in range(1000):
        filtered += (speed - filtered) * step / SETTINGS.velocity_lag
        speed += (torque - 0.5) / INERTIA * step
        total += filtered / 1000.0
    assert barrier.mean_filtered(torque) == pytest.approx(total, abs=2e-3)


def test_while_commands_are_lost_the_bounds_are_good_for_the_one_that_is_kept_too():
    barrier = seen(dq=4.8)
    highest = barrier.highest
    # The board may go on with more torque than it was told last.
    barrier.update(0.0, 4.8, 0.0, 0.0, INERTIA, DT, DT, kept=3.0)
    assert barrier.highest < highest - 0.5
    assert barrier.dq == pytest.approx(4.8 + 3.0 / INERTIA * DT, abs=0.02)
    # With less, what it was told last counts.
    barrier = seen(dq=4.8)
    barrier.update(0.0, 4.8, 0.0, 0.0, INERTIA, DT, DT, kept=-3.0)
    assert barrier.highest == pytest.approx(highest)
    assert barrier.dq == pytest.approx(4.8, abs=0.02)


def test_loads_are_learned_from_the_torque_that_acted():
    def learned(was_kept):
        barrier = seen()
        for cycle in range(20):
            # The joint is led by the torque that was kept; the last command never arrives.
            speed = 2.0 / INERTIA * DT * (cycle + 1)
            barrier.update(0.0, speed, 0.0, 0.0, INERTIA, DT, DT, 2.0, was_kept and cycle > 0)
        return barrier.load

    assert abs(learned(was_kept=True)) < 0.5 < abs(learned(was_kept=False))


def test_a_stiff_law_that_ends_by_itself_needs_no_damping():
    barrier = seen()
    assert barrier.gap_damping(5.0) > 0.0
    assert barrier.gap_damping(5.0, 5.0, 0.0, 1.0) == 0.0  # at 5 rad/s, by its damping
    assert barrier.gap_damping(5.0, 5.0, 100.0, 0.0) == 0.0  # 5 rad/s, by the energy of its spring
    # A drive that is too weak for its law goes on with all it has.
    assert barrier.gap_damping(5.0, 50.0, 100.0, 1.0) > 0.0


def test_a_fast_joint_with_low_gains_is_damped_against_coupling_torque():
    assert seen(dq=4.8).gap_damping(0.0, 0.0, 0.0, 0.2) > 0.0
    assert seen(dq=4.8).gap_damping(0.0, 0.0, 0.0, 20.0) == 0.0
    assert seen(dq=1.0).gap_damping(0.0, 0.0, 0.0, 0.2) == 0.0


def test_an_overloaded_joint_of_a_warm_motor_is_slowed_to_a_tenth_and_recovers():
    barrier = make_barrier()
    fastest = barrier.speed(2.0)
    barrier.limit_speed(True)
    assert barrier.is_slowed
    barrier.recover(DT)
    assert barrier.speed(2.0) == pytest.approx(fastest * (1.0 - DT / 0.3))
    for _ in range(400):
        barrier.recover(DT)
    assert barrier.speed(2.0) == pytest.approx(0.1 * fastest)
    barrier.limit_speed(False)
    barrier.recover(0.1)
    assert barrier.speed(2.0) == pytest.approx(0.2 * fastest)
    barrier.recover(2.0)
    assert not barrier.is_slowed
    assert barrier.speed(2.0) == fastest


def test_a_released_joint_moves_slowly_wherever_it_is():
    barrier = seen(q=JOINT.position_max + 0.1, dq=0.1)
    barrier.is_released = True
    assert barrier.speed(-0.1) == barrier.speed(3.0) == pytest.approx(0.05 * JOINT.velocity_max)
    barrier.update(JOINT.position_max + 0.1, 0.1, 0.0, 0.0, INERTIA, DT, DT)
    assert barrier.highest == pytest.approx(250.0 * INERTIA * 0.15, rel=0.05)
    slowed = make_barrier()
    slowed.is_released = True
    slowed.limit_speed(True)
    slowed.lower_speed_limit(1.0)
    slowed.recover(1.0)
    assert slowed.speed(3.0) == pytest.approx(0.05 * JOINT.velocity_max)


def test_a_learned_load_counts_for_a_gap_with_its_sign():
    # 0.5 Nm more than known hold the joint; with both loads the larger damping applies.
    barrier = seen(effort=0.5)
    per_speed = JOINT.velocity_max * INERTIA / SETTINGS.board_timeout
    most = min(1.1 * per_speed, 1.15 * per_speed - PULL)
    assert barrier.gap_damping(most - 0.02) == 0.0
    assert barrier.gap_damping(-most + 0.45) > 0.0  # more than the load that was learned
    assert barrier.gap_damping(most + 0.05) > 0.0  # more than the load of the model


@pytest.mark.parametrize('way', [1.0, -1.0])
def test_a_fast_joint_is_damped_by_what_coupling_may_add_to_its_torque(way):
    barrier, margin = seen(dq=4.8 * way), 0.15 * JOINT.effort_max
    # A braking torque that is smaller than the margin leaves the rest of it to drive the joint.
    torques = [way * torque for torque in (0.5, 0.0, -0.5)]
    alone = [barrier.gap_damping(torque, torque, 0.0, 0.2) for torque in torques]
    assert alone == sorted(alone, reverse=True)
    assert alone[2] == pytest.approx((margin - 0.5) / (1.1 * JOINT.velocity_max - 4.8), rel=0.3)
    assert barrier.gap_damping(-way * (margin + 0.1), -way * (margin + 0.1), 0.0, 0.2) == 0.0
