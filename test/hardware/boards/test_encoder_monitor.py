import numpy as np
import pytest

from aerarm_ros.hardware.boards.encoder_monitor import EncoderMonitor

FRESH = np.ones(4, dtype=bool)
NONE = np.zeros(4)


@pytest.fixture
def monitor(config):
    monitor = EncoderMonitor(config, stall_time=0.05)
    monitor.check(NONE, NONE, FRESH, 0.0)
    return monitor


def ramp(monitor, slope, current, start=0.0, cycles=200):
    """Turn all motors at a speed [rad/s] while currents change; return the first complaint."""
    for cycle in range(1, cycles + 1):
        time = start + cycle * 1e-3
        position = np.full(4, slope * cycle * 1e-3)
        text = monitor.check(position, np.asarray(current(cycle * 1e-3)), FRESH, time)
        if text:
            return text
    return ''


def test_motion_at_the_velocity_limit_is_fine(monitor, config):
    assert ramp(monitor, 5.0 / config.joints[0].gear.ratio, lambda t: NONE) == ''


@pytest.mark.parametrize('angle', [np.pi, -np.pi, 0.5])
def test_a_jump_is_seen_and_its_joint_named(monitor, angle):
    jumped = NONE.copy()
    jumped[2] = angle
    assert 'encoder of joint3 jumped' in monitor.check(jumped, NONE, FRESH, 1e-3)
    assert monitor.trusted.tolist() == [True, True, False, True]
    monitor.clear()
    assert monitor.trusted.all()
    assert monitor.check(jumped + 5.0, NONE, FRESH, 2e-3) == ''


def test_after_bad_frames_the_change_may_be_larger(monitor):
    moved = np.array([100.0, 0, 0, 0]) * 0.01
    for cycle in range(1, 10):
        assert monitor.check(NONE, NONE, np.array([False, False, True, True]), cycle * 1e-3) == ''
    assert monitor.check(moved, NONE, FRESH, 0.010) == ''


def test_standstill_while_the_torque_turns_round_is_stiction(monitor, config):
    friction = config.column('coulomb') / config.column('torque_per_ampere')

    def current(t):
        return 1.4 * friction * np.cos(20.0 * t)

    assert ramp(monitor, 0.0, current, cycles=1000) == ''


def test_standstill_under_a_constant_load_is_no_fault(monitor):
    ramp(monitor, 1.0, lambda t: np.full(4, 8.0))
    for cycle in range(1000):
        assert monitor.check(np.full(4, 0.2), np.full(4, 8.0), FRESH, 0.2 + cycle * 1e-3) == ''


def test_standstill_while_the_torque_grows_beyond_friction_is_a_fault(monitor):
    text = ramp(monitor, 0.0, lambda t: [0.0, 20.0 * t, 0.0, 0.0])
    assert 'joint2 does not move' in text
    assert 'stuck encoder' in text
    assert monitor.trusted.tolist() == [True, False, True, True]


def test_pauses_between_two_looks_prove_nothing(monitor):
    for cycle in range(1, 200):
        current = [0.0, 0.2 * cycle, 0.0, 0.0]
        assert monitor.check(NONE, np.array(current), FRESH, 8e-3 * cycle) == ''


def test_a_short_standstill_is_borne(monitor):
    for cycle in range(1, 400):
        position = np.full(4, 0.002 * (cycle // 40))  # a count every 40 ms
        assert monitor.check(position, np.full(4, 0.3 * cycle), FRESH, cycle * 1e-3) == ''


@pytest.fixture
def flying(config):
    """Return a monitor of an arm whose load changes with the attitude of its base."""
    monitor = EncoderMonitor(config, stall_time=0.05, load_max=[4.7, 4.7, 0.06, 0.06])
    monitor.check(NONE, NONE, FRESH, 0.0)
    return monitor


def stand(monitor, feedback, commanded, cycles=2000):
    """Keep all motors still while currents [A] change; return the first complaint."""
    for cycle in range(1, cycles + 1):
        time = cycle * 1e-3
        effort = np.asarray(commanded(time))
        text = monitor.check(NONE, effort + feedback(time), FRESH, time, effort)
        if text:
            return text
    return ''


def test_a_load_that_comes_with_the_base_is_held_without_a_fault(flying, config):
    swing = 4.7 / config.column('torque_per_ampere') * [1.0, 1.0, 0.0, 0.0]
    assert stand(flying, lambda t: NONE, lambda t: swing * np.sin(np.pi * t)) == ''


def test_a_load_no_arm_can_have_is_a_fault(flying):
    text = stand(flying, lambda t: NONE, lambda t: [0.0, 0.0, 0.0, 2.0 * t])
    assert 'joint4 does not move' in text
    assert flying.trusted.tolist() == [True, True, True, False]


def test_feedback_that_moves_nothing_is_a_fault_under_any_load(flying, config):
    swing = 4.7 / config.column('torque_per_ampere') * [1.0, 1.0, 0.0, 0.0]
    text = stand(flying, lambda t: [0.0, 2.0 * t, 0.0, 0.0], lambda t: swing * np.sin(np.pi * t))
    assert 'joint2 does not move' in text


def test_a_load_handed_from_the_feedback_to_a_controller_is_no_fault(flying) -> None:
    # The arm was held by the boards where it came to rest; a good controller moves no count.
    load = np.array([0.0, 4.0, 0.0, 0.0])
    for cycle in range(1, 300):
        position = np.full(4, 0.002 * min(cycle, 20))
        commanded = NONE if cycle < 100 else load
        assert flying.check(position, load, FRESH, cycle * 1e-3, commanded) == ''
