from dataclasses import replace
from math import inf

import numpy as np
import pytest

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.emulation.emulated_motor import CRITICAL, EmulatedHeat
from aerarm_ros.hardware.heat_watch import ThermalLimit

STEP = 0.02


def limit(config: ArmConfig, joint: int = 1, ambient: float = 25.0, start: float = 25.0):
    return ThermalLimit(config.joints[joint], ambient, start)


def drive(limited: ThermalLimit, config: ArmConfig, joint: int, seconds: float, current=inf):
    """Give the motor all the current that it may take, up to `current`; return every limit."""
    per_ampere, limits = config.joints[joint].torque_per_ampere, []
    for step in range(round(seconds / STEP)):
        limited.add(min(current, limited.effort_limit / per_ampere), STEP)
        limited.update(0.0)
        if step % 50 == 0:
            limited.forecast()
        limits.append(limited.effort_limit)
    return np.array(limits)


@pytest.mark.parametrize('joint', [0, 1, 2])
@pytest.mark.parametrize(('ambient', 'start'), [(25.0, 25.0), (25.0, 60.0), (45.0, 60.0)])
def test_no_command_heats_a_winding_above_its_largest_temperature(config, joint, ambient, start):
    limited = limit(config, joint, ambient, start)
    limits = drive(limited, config, joint, 60.0)
    hottest = config.joints[joint].motor.thermal.temperature_max
    drive(limited, config, joint, 120.0)
    assert hottest - 15.0 < limited.motor.winding < hottest - 4.0
    assert not limited.stop()
    # Reduced steadily, to the continuous current at most.
    assert np.all(np.diff(limits) <= 1e-9)
    assert np.abs(np.diff(limits)).max() <= STEP * config.joints[joint].effort_max * 1.001
    continuous = limited.continuous_current * config.joints[joint].torque_per_ampere
    assert limits[-1] >= continuous * 0.999
    assert limited.continuous_current <= config.joints[joint].motor.thermal.continuous_current


def test_the_order_is_warning_reduction_stop(config):
    limited, seen = limit(config), []
    for _ in range(100):
        # A load that nobody can lower: a barrier that holds the arm at a limit.
        for _ in range(50):
            limited.add(10.3, STEP)
            limited.update(0.0)
        limited.forecast()
        seen.append((bool(limited.warning()), limited.is_reduced, bool(limited.stop())))
    warned, reduced, stopped = (row.index(True) for row in np.array(seen).T.tolist())
    assert warned + 20 < reduced < stopped
    assert 'is limited' in limited.warning() or limited.is_released


def test_the_warning_states_the_remaining_time(config):
    limited = limit(config)
    drive(limited, config, 1, 25.0, 10.0)
    assert limited.warning().startswith('the motor of joint2 has')
    left = limited.remaining
    assert f'limits its torque in {left:.0f} s' in limited.warning()
    drive(limited, config, 1, left - 1.0, 10.0)
    assert not limited.is_reduced
    drive(limited, config, 1, 2.5, 10.0)
    assert limited.is_reduced


def test_torque_comes_back_as_the_motor_cools(config):
    limited = limit(config)
    drive(limited, config, 1, 60.0)
    assert limited.is_reduced
    assert limited.refusal()
    limits = drive(limited, config, 1, 60.0, 0.0)
    assert np.all(np.diff(limits) >= -1e-9)
    assert limits[-1] == config.joints[1].effort_max
    assert not limited.refusal()
    assert limited.warning() == ''


def test_an_arm_sinks_once_its_load_is_more_than_the_reduced_torque(config):
    limited = limit(config)
    drive(limited, config, 1, 60.0)
    for _ in range(100):
        limited.add_load(0.8 * limited.effort_limit)
    assert not limited.is_sinking
    for _ in range(100):
        limited.add_load(-1.2 * limited.effort_limit)
    assert limited.is_sinking
    assert 'joint2 sinks' in limited.warning()
    limited.rest()
    assert not limited.is_sinking


def test_without_a_reduction_no_load_lets_an_arm_sink(config):
    limited = limit(config)
    limited.add_load(100.0)
    assert not limited.is_sinking


def test_a_motor_without_data_counts_a_third_of_its_current(config):
    joint = config.joints[1]
    joint = replace(joint, motor=replace(joint.motor, thermal=None))
    limited = ThermalLimit(joint, 25.0, 25.0)
    assert limited.continuous_current == pytest.approx(0.33 * 16.0, rel=0.05)


@pytest.mark.parametrize('period', [0.5, 4.0, 20.0])
def test_repeated_full_torque_never_causes_a_temperature_error_of_the_board(config, period):
    """All motors at their thermal torque limit half of the time, as manufactured, by seeds."""
    step = 0.05
    for joint in config.joints[:3]:
        for seed in range(4):
            true, limited = EmulatedHeat(joint.motor, seed), ThermalLimit(joint, 25.0, 25.0)
            hottest = 0.0
            for number in range(2000):
                works = (step * number) % period < 0.5 * period
                current = limited.effort_limit / joint.torque_per_ampere if works else 0.0
                true.step(current**2, 100.0, step)
                limited.add(current, step)
                limited.update(true.resistance)
                hottest = max(hottest, true.copper)
            assert 90.0 < hottest < CRITICAL - 2.0, (joint.name, seed)
            assert not limited.stop()
