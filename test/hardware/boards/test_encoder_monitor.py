import numpy as np
import pytest

from aerarm_ros.hardware.boards.encoder_monitor import EncoderMonitor

FRESH = [True] * 4
NONE = np.zeros(4)


@pytest.fixture
def monitor(config):
    monitor = EncoderMonitor(config, stall_time=0.05)
    monitor.check(NONE, NONE, FRESH, 0.0)
    return monitor


def ramp(monitor, slope, current, start=0.0, cycles=200):
    """Turn all motors at a speed [rad/s] with changing currents; return the first complaint."""
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
        assert monitor.check(NONE, NONE, [False, False, True, True], cycle * 1e-3) == ''
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


def test_a_short_standstill_is_tolerated(monitor):
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
    """Keep all motors still with changing currents [A]; return the first complaint."""
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


def test_initially_every_encoder_is_trusted(monitor):
    assert monitor.trusted.dtype == bool
    assert monitor.damping_speed.tolist() == [np.inf] * 4


def look(monitor, position, now, interval=None):
    """Check motor 2 alone at an angle [rad]; return the complaint and its damping limit."""
    angles = NONE.copy()
    angles[1] = position
    longest = None if interval is None else [interval] * 4
    text = monitor.check(angles, NONE, FRESH, now, interval_max=longest)
    return text, monitor.damping_speed[1]


def test_between_two_looks_at_a_jump_its_joint_is_damped_up_to_the_speed_before(monitor):
    look(monitor, 0.1, 1e-3)
    text, speed = look(monitor, 3.1, 2e-3)
    assert text == (
        'the encoder of joint2 jumped by 3.00 rad (motor side): check its cable and mounting, then '
        'home the arm'
    )
    assert speed == pytest.approx(1.5 * 100.0 + 5.0)
    assert monitor.damping_speed[[0, 2, 3]].tolist() == [np.inf] * 3


def test_after_one_wrong_reading_the_joint_is_still_damped(monitor):
    assert look(monitor, 3.0, 1e-3)[1] == 5.0  # it stood before
    assert look(monitor, 0.0, 2e-3) == ('', np.inf)
    assert monitor.trusted.tolist() == [True, False, True, True]
    assert monitor.lost == []  # its count is right again
    # It is another jump that comes later.
    assert look(monitor, 3.0, 3e-3)[1] == 5.0


def test_a_jump_that_stays_is_confirmed_by_the_second_look(monitor):
    look(monitor, 3.0, 1e-3)
    text, speed = look(monitor, 3.0, 2e-3)
    assert 'jumped by 3.00 rad' in text
    assert speed == 0.0
    # A confirmed one stays so until somebody clears it.
    assert look(monitor, 3.0, 3e-3)[1] == 0.0
    assert monitor.lost == [1]
    monitor.clear()
    assert monitor.lost == []
    assert monitor.damping_speed.tolist() == [np.inf] * 4
    assert look(monitor, 0.0, 4e-3) == ('', np.inf)


def test_the_second_reading_is_compared_with_the_motion_possible_since_before_the_jump(
    monitor, config
):
    fastest = 2.0 * config.joints[1].velocity_max / config.joints[1].gear.ratio
    # Too far for a millisecond, not for the four of both looks.
    angle = 3.9e-3 * fastest
    assert look(monitor, angle, 1e-3, 1e-3)[0] != ''
    assert look(monitor, angle, 2e-3, 3e-3) == ('', np.inf)
    # But it stood: its count is not where it was.
    assert monitor.lost == [1]


def test_two_looks_at_a_jump_are_not_one_long_one(monitor, config):
    fastest = 2.0 * config.joints[1].velocity_max / config.joints[1].gear.ratio
    angle = 2.5e-3 * fastest + 0.05
    assert look(monitor, angle, 1e-3, 2e-3)[0] != ''
    assert look(monitor, angle, 2e-3, 0.2e-3)[1] == 0.0


def test_after_a_host_delay_the_longest_interval_is_assumed(monitor):
    assert look(monitor, 1.0, 1e-3, 20e-3) == ('', np.inf)
    assert look(monitor, 2.0, 2e-3, 1e-3)[0] != ''


def test_a_board_without_an_answer_hides_no_other(monitor):
    jumped = np.array([0.0, 0.0, 3.0, 0.0])
    fresh = [False, False, True, True]
    assert 'joint3 jumped' in monitor.check(jumped, NONE, fresh, 1e-3)


def test_standing_on_is_confirmed_after_as_long_again(monitor):
    doubted, confirmed = [], []
    for cycle in range(1, 120):
        text = monitor.check(NONE, np.array([0.0, 20.0, 0.0, 0.0]), FRESH, cycle * 1e-3)
        doubted.append(text != '')
        confirmed.append(monitor.damping_speed[1] == 0.0)
        assert confirmed[-1] or monitor.damping_speed[1] == np.inf
    assert monitor.lost == [1]
    assert doubted.index(True) == pytest.approx(50, abs=1)
    assert confirmed.index(True) == pytest.approx(101, abs=1)
    assert all(confirmed[105:])
    assert text == (
        'joint2 does not move although its current changed to 20.0 A: check for a stuck encoder or '
        'a blocked joint'
    )


def test_standing_counts_the_time_of_the_looks_not_the_longest_that_it_can_have_been(monitor):
    current, longest = np.array([0.0, 20.0, 0.0, 0.0]), [2.9e-3] * 4
    faults = [
        monitor.check(NONE, current, FRESH, cycle * 1e-3, interval_max=longest) != ''
        for cycle in range(1, 80)
    ]
    assert faults.index(True) == pytest.approx(50, abs=1)


def test_an_encoder_that_moves_again_is_not_confirmed_as_stuck(monitor):
    current = np.array([0.0, 20.0, 0.0, 0.0])
    for cycle in range(1, 80):
        monitor.check(NONE, current, FRESH, cycle * 1e-3)
    assert not monitor.trusted[1]
    moved = np.array([0.0, 0.01, 0.0, 0.0])
    for cycle in range(80, 200):
        assert monitor.check(moved, current, FRESH, cycle * 1e-3) == ''
    assert monitor.damping_speed[1] == np.inf
    assert monitor.lost == []


def test_an_encoder_that_moves_again_is_reliable_but_suspect_until_cleared(monitor):
    current = np.array([0.0, 20.0, 0.0, 0.0])
    for cycle in range(1, 80):
        monitor.check(NONE, current, FRESH, cycle * 1e-3)
    assert monitor.is_position_reliable.tolist() == [True, False, True, True]
    for cycle, moved in enumerate([0.01, 0.04, 0.06], start=80):
        monitor.check(np.array([0.0, moved, 0.0, 0.0]), current, FRESH, cycle * 1e-3)
        assert monitor.is_position_reliable[1] == (moved > 0.05)
    assert not monitor.trusted[1]
    monitor.check(np.array([0.0, 3.06, 0.0, 0.0]), current, FRESH, 83e-3)
    assert not monitor.is_position_reliable[1]  # a jump says that it is somewhere else
    monitor.check(np.array([0.0, 3.0, 0.0, 0.0]), current, FRESH, 84e-3)
    assert not monitor.is_position_reliable[1]
    monitor.clear()
    assert monitor.is_position_reliable.all()


def test_an_encoder_that_jumps_back_and_forth_is_not_trusted_the_third_time(monitor):
    speeds = [look(monitor, 3.0 * (cycle % 2), cycle * 1e-3)[1] for cycle in range(1, 8)]
    assert speeds == [5.0, np.inf, 5.0, np.inf, 0.0, 0.0, 0.0]


def test_a_confirmed_stuck_encoder_is_no_longer_reliable(monitor):
    current = np.array([0.0, 20.0, 0.0, 0.0])
    for cycle in range(1, 120):
        monitor.check(NONE, current, FRESH, cycle * 1e-3)
    monitor.check(np.array([0.0, 0.1, 0.0, 0.0]), current, FRESH, 120e-3)
    assert not monitor.is_position_reliable[1]


@pytest.mark.parametrize('joint', range(4))
def test_dry_friction_and_as_much_again_holds_a_joint_whichever_way(monitor, config, joint):
    dry = (config.column('coulomb') / config.column('torque_per_ampere'))[joint]

    def stands(change):
        monitor.clear()
        current = NONE.copy()
        for cycle in range(300):
            current[joint] = dry * (-0.5 + change * min(cycle / 100.0, 1.0))
            angle = np.full(4, 0.002 * (cycle == 0))
            if monitor.check(angle, current, FRESH, cycle * 1e-3):
                return False
        return True

    assert stands(3.9)
    assert not stands(5.5)


def test_the_braking_current_of_a_joint_ends_when_it_rests(monitor):
    def rest_after(braking, rest):
        monitor.clear()
        for cycle in range(20):
            angle, current = np.full(4, 0.002 * cycle), np.full(4, braking)
            assert monitor.check(angle, current, FRESH, cycle * 1e-3) == ''
        text = ''
        for cycle in range(20, 120):
            current = np.full(4, rest(cycle - 20))
            text = text or monitor.check(angle, current, FRESH, cycle * 1e-3)
        return text

    assert rest_after(9.0, lambda cycle: 0.0) == ''
    # It is gone in the first cycle at rest, not bit by bit.
    assert 'does not move' in rest_after(9.0, lambda cycle: max(9.0 - 0.2 * cycle, 0.0))
    # And braking does not explain a current that grows.
    assert 'does not move' in rest_after(1.0, lambda cycle: 9.0)


@pytest.mark.parametrize('noise', [0.0, 4.0])
def test_counts_shake_a_joint_that_the_bridge_brakes(monitor, noise):
    text = ''
    for cycle in range(1, 200):
        current, noises = np.full(4, 3.0 * (cycle % 2)), np.full(4, noise)
        text = text or monitor.check(NONE, current + 2.0, FRESH, cycle * 1e-3, braking_noise=noises)
    assert (text == '') == (noise > 0.0)


def test_an_arm_whose_load_does_not_change_stands_under_no_effort(monitor):
    # 1 Nm, ten times the dry friction.
    text = stand(monitor, lambda t: NONE, lambda t: [0.0, min(20.0 * t, 1.7), 0.0, 0.0], cycles=300)
    assert 'joint2 does not move' in text


def test_feedback_that_turns_round_moves_a_joint_under_any_load(flying):
    faults = []
    for cycle in range(200):
        feedback = np.array([0.0, 2.0 if cycle < 100 else -2.0, 0.0, 0.0])
        angle = np.full(4, 0.002 * (cycle < 1))
        faults.append(flying.check(angle, feedback, FRESH, cycle * 1e-3, NONE) != '')
    assert faults.index(True) == pytest.approx(150, abs=1)


CURRENT, INERTIA = 3.0, 0.05  # [A], [kg m^2]


def driven(monitor, config, stuck_after=0.05, pause=0.0, noise=0.0, load=lambda time: 0.0):
    """Drive joint 4 from rest by a current; return the complaint and its time.

    The encoder sticks after a time [s], with a pause [s] there; the other joints rest.
    """
    joint = config.joints[3]
    rate = CURRENT * joint.torque_per_ampere / INERTIA / joint.gear.ratio  # [rad/s^2] motor side
    count = 2.0 * np.pi / 4096.0
    time, current, noises = 0.0, np.array([0.0, 0.0, 0.0, CURRENT]), np.array([0, 0, 0, noise])
    while time < stuck_after + 0.04:
        time += pause if pause and stuck_after <= time < stuck_after + 0.0015 else 1e-3
        angle = np.floor(0.5 * rate * min(time, stuck_after) ** 2 / count) * count
        position = np.array([0.0, 0.0, 0.0, angle])
        loads = [0.0, 0.0, 0.0, load(time)]
        known = {'inertias': [0.3, 0.3, 0.05, INERTIA], 'loads': loads}
        text = monitor.check(position, current, FRESH, time, None, noises, **known)
        if text:
            return text, time - stuck_after
    return '', np.inf


def test_an_encoder_that_sticks_at_constant_current_is_detected_by_the_expected_motion(
    monitor, config
):
    text, after = driven(monitor, config)
    assert text.startswith('joint4 does not move although its speed and its current of 3.0 A')
    assert 2e-3 < after < 8e-3
    assert monitor.trusted.tolist() == [True, True, True, False]


def test_an_intact_encoder_is_trusted_in_the_same_motion(monitor, config):
    assert driven(monitor, config, stuck_after=0.1)[1] > 0.0


def test_a_load_that_the_model_knows_to_change_may_hold_it(monitor, config):
    torque = CURRENT * config.joints[3].torque_per_ampere
    assert driven(monitor, config, load=lambda time: 30.0 * torque * (time > 0.0505))[0] == ''


def test_a_constant_load_does_not_explain_a_standstill(monitor, config):
    torque = CURRENT * config.joints[3].torque_per_ampere
    assert driven(monitor, config, load=lambda time: 30.0 * torque)[1] < 8e-3


def test_current_noise_of_a_braked_joint_may_hold_it(monitor, config):
    assert driven(monitor, config, noise=20.0 * CURRENT)[0] == ''


def test_after_a_pause_the_expected_motion_starts_from_rest(monitor, config):
    # From rest it takes 17 ms to have turned clearly.
    assert 0.02 < driven(monitor, config, pause=8e-3)[1] < 0.035
