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


def make_barrier():
    return JointBarrier(JOINT, SETTINGS, DECELERATION, INERTIA)


def seen(q=0.0, dq=0.0, effort=0.0, load=0.0):
    """Return a barrier that has seen a joint go on like this for some cycles."""
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


def test_on_the_barrier_the_torque_is_what_brakes_along_it():
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


def test_what_is_learned_is_bounded():
    assert seen(effort=9.0, load=0.0).load == pytest.approx(0.15 * JOINT.effort_max)


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
