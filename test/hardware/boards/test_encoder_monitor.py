import numpy as np
import pytest

from aerarm_ros.hardware.boards.encoder_monitor import EncoderMonitor

FRESH = [True] * 4
NONE = np.zeros(4)
UNKNOWN = [np.nan] * 4
HEAVY = [4.7, 4.7, 0.06, 0.06]  # [Nm] gravity load of an arm on a base that turns


def of(joint, value):
    """Return the values (4,) of all joints, 0 except for one joint number."""
    return np.where(np.arange(4) == joint, value, 0.0)


def check(monitor, position, current, now, longest=None, **given):
    """Check all encoders; the last check was `longest` [s] ago, by default by the clock."""
    intervals = [
        now - encoder.seen if longest is None else longest for encoder in monitor._encoders
    ]
    names = ('fresh', 'commanded', 'noise', 'inertias', 'loads')
    defaults = dict(zip(names, (FRESH, NONE, NONE, UNKNOWN, NONE), strict=True)) | given
    fresh, commanded, noise, inertias, loads = defaults.values()
    position, current = np.broadcast_to(position, 4), np.broadcast_to(current, 4)
    return monitor.check(
        position, current, fresh, now, commanded, noise, intervals, inertias, loads
    )


@pytest.fixture
def monitor(config):
    monitor = EncoderMonitor(config, stall_time=0.05)
    assert monitor.trusted.tolist() == [True] * 4
    assert monitor.damping_speed.tolist() == [np.inf] * 4
    check(monitor, NONE, NONE, 0.0)
    return monitor


@pytest.fixture
def flying(config):
    """Return a monitor of an arm whose load changes with the attitude of its base."""
    monitor = EncoderMonitor(config, stall_time=0.05, load_max=HEAVY)
    check(monitor, NONE, NONE, 0.0)
    return monitor


def first_fault(monitor, cycles, angle, current, begin=0, step=1e-3, **changing):
    """Check with functions of the cycle; return the first fault and its cycle, or '' and inf."""
    for cycle in range(begin + 1, begin + cycles + 1):
        given = {name: values(cycle) for name, values in changing.items()}
        text = check(monitor, angle(cycle), current(cycle), step * cycle, **given)
        if text:
            return text, cycle
    return '', np.inf


def still(cycle):
    return NONE


@pytest.mark.parametrize('joint', [0, 2])
@pytest.mark.parametrize('angle', [np.pi, -np.pi, 0.5])
def test_a_jump_is_seen_and_its_joint_named(monitor, joint, angle):
    fresh = [number >= joint for number in range(4)]  # a silent board hides no other
    assert f'encoder of joint{joint + 1} jumped' in check(
        monitor, of(joint, angle), 0.0, 1e-3, fresh=fresh
    )
    assert monitor.trusted.tolist() == [number != joint for number in range(4)]
    assert monitor.has_doubts
    monitor.clear()
    assert monitor.trusted.all()
    assert not monitor.has_doubts
    assert check(monitor, of(joint, angle + 5.0), 0.0, 2e-3) == ''


def test_fast_motion_is_no_jump_also_after_bad_frames(monitor, config):
    speed = 5.0 / config.joints[0].gear.ratio
    assert first_fault(monitor, 200, lambda k: speed * 1e-3 * k, still)[0] == ''
    monitor.clear()
    for cycle in range(201, 211):
        fresh = [cycle in (201, 210)] * 2 + [True] * 2
        assert check(monitor, of(0, 1.0 * (cycle == 210)), 0.0, cycle * 1e-3, fresh=fresh) == ''


@pytest.mark.parametrize(
    ('load_max', 'angle', 'current'),
    [
        (0.0, lambda k: 0.0, lambda k: 1.4 * np.cos(0.02 * k)),  # stiction, times its dry friction
        (0.0, lambda k: 1e-3 * min(k, 200), lambda k: 8.0),  # a constant load
        (0.0, lambda k: 0.002 * (k // 40), lambda k: 0.3 * k),  # a count every 40 ms
    ],
)
def test_standing_still_is_no_fault_where_friction_or_a_count_explains_it(
    config, load_max, angle, current
):
    monitor = EncoderMonitor(config, 0.05, load_max)
    dry = config.column('coulomb') / config.column('torque_per_ampere')
    scale = dry if current(0) == 1.4 else 1.0
    assert first_fault(monitor, 1000, angle, lambda k: current(k) * scale)[0] == ''


def test_pauses_between_two_looks_prove_nothing(monitor):
    assert first_fault(monitor, 200, still, lambda k: of(1, 0.2 * k), step=8e-3)[0] == ''


def test_standstill_while_the_torque_grows_beyond_friction_is_a_fault(monitor):
    text, _ = first_fault(monitor, 200, still, lambda k: of(1, 0.02 * k))
    assert 'joint2 does not move' in text
    assert 'stuck encoder' in text
    assert monitor.trusted.tolist() == [True, False, True, True]
    monitor.clear()
    # 1 Nm is ten times the dry friction: no load that does not change explains it.
    effort = lambda k: of(1, min(0.02 * (k - 200), 1.7))  # noqa: E731
    found = first_fault(monitor, 300, still, effort, 200, commanded=effort)
    assert 'joint2 does not move' in found[0]


def test_a_load_that_comes_with_the_base_is_held_and_another_one_is_a_fault(flying, config):
    def swing(cycle):
        load = 4.7 / config.column('torque_per_ampere') * [1.0, 1.0, 0.0, 0.0]
        return load * np.sin(1e-3 * np.pi * cycle)

    assert first_fault(flying, 2000, still, swing, commanded=swing)[0] == ''
    flying.clear()
    # Feedback that moves nothing is a fault under any load, and so is a load that no arm can have.
    text, _ = first_fault(
        flying, 2000, still, lambda k: swing(k) + of(1, 2e-3 * (k - 2000)), 2000, commanded=swing
    )
    assert 'joint2 does not move' in text
    flying.clear()
    heavy = [of(3, 2e-3 * k) for k in range(2001)]
    text, _ = first_fault(flying, 2000, still, lambda k: heavy[k - 4000], 4000,
                          commanded=lambda k: heavy[k - 4000])  # fmt: skip
    assert 'joint4 does not move' in text
    assert flying.trusted.tolist() == [True, True, True, False]


def test_a_load_handed_from_the_feedback_to_a_controller_is_no_fault(flying) -> None:
    # The arm was held by the boards where it came to rest; a good controller moves no count.
    load = of(1, 4.0)
    found = first_fault(flying, 300, lambda k: 0.002 * min(k, 20), lambda k: load,
                        commanded=lambda k: NONE if k < 100 else load)  # fmt: skip
    assert found[0] == ''


def look(monitor, position, now, longest=None):
    """Check joint 2 alone at an angle [rad]; return the complaint and its damping limit."""
    return check(monitor, of(1, position), 0.0, now, longest), monitor.damping_speed[1]


def test_between_two_looks_at_a_jump_its_joint_is_damped_up_to_the_speed_before(monitor):
    look(monitor, 0.1, 1e-3)
    text, speed = look(monitor, 3.1, 2e-3)
    assert text == (
        'the encoder of joint2 jumped by 3.00 rad (motor side): check its cable and mounting, then '
        'home the arm'
    )
    assert speed == pytest.approx(1.5 * 100.0 + 5.0)
    assert monitor.damping_speed[[0, 2, 3]].tolist() == [np.inf] * 3


def test_one_wrong_reading_keeps_the_damping_and_the_third_ends_it(monitor):
    speeds = [look(monitor, 3.0 * (cycle % 2), cycle * 1e-3)[1] for cycle in range(1, 4)]
    assert speeds == [5.0, np.inf, 5.0]  # it stood before
    assert look(monitor, 0.0, 4e-3) == ('', np.inf)
    assert monitor.trusted.tolist() == [True, False, True, True]
    assert monitor.lost == []  # its count is right again
    assert [look(monitor, 3.0 * (cycle % 2), cycle * 1e-3)[1] for cycle in (5, 6)] == [0.0, 0.0]


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
    assert monitor.lost == [1]  # it stood, so its count is not where it was
    monitor.clear()
    # Two looks at a jump are not one long one.
    look(monitor, 0.0, 3e-3)
    assert look(monitor, 2.5e-3 * fastest + 0.05, 4e-3, 2e-3)[0] != ''
    assert look(monitor, 2.5e-3 * fastest + 0.05, 5e-3, 0.2e-3)[1] == 0.0


def test_a_slow_drift_during_a_doubt_is_no_lost_count(monitor):
    look(monitor, 3.0, 1e-3)
    assert look(monitor, 0.05 + 5.0 * 2e-3, 2e-3) == ('', np.inf)
    assert monitor.lost == []


def test_after_a_host_delay_the_longest_interval_is_assumed(monitor):
    assert look(monitor, 1.0, 1e-3, 20e-3) == ('', np.inf)
    assert look(monitor, 2.0, 2e-3, 1e-3)[0] != ''


@pytest.mark.parametrize('longest', [None, 2.9e-3])
def test_standing_on_is_confirmed_after_as_long_again(monitor, longest):
    """The time of the looks counts, and not the longest that it can have been."""
    doubted, confirmed = [], []
    for cycle in range(1, 120):
        text = check(monitor, NONE, of(1, 20.0), cycle * 1e-3, longest)
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
    check(monitor, of(1, 0.1), of(1, 20.0), 120e-3)
    assert not monitor.is_position_reliable[1]


def test_an_encoder_that_moves_again_is_reliable_but_suspect_until_cleared(monitor):
    current = of(1, 20.0)
    first_fault(monitor, 60, still, lambda k: current)
    assert monitor.is_position_reliable.tolist() == [True, False, True, True]
    for cycle, moved in enumerate([0.01, 0.04, 0.06], start=80):
        check(monitor, of(1, moved), current, cycle * 1e-3)
        assert monitor.is_position_reliable[1] == (moved > 0.05)
    assert not monitor.trusted[1]
    for cycle in range(83, 200):  # standing on is not confirmed
        assert check(monitor, of(1, 0.06), current, cycle * 1e-3) == ''
    assert monitor.damping_speed[1] == np.inf
    assert monitor.lost == []
    for cycle in (200, 201):  # a jump says that it is somewhere else
        check(monitor, of(1, 3.06), current, cycle * 1e-3)
        assert not monitor.is_position_reliable[1]
    monitor.clear()
    assert monitor.is_position_reliable.all()


@pytest.mark.parametrize('joint', range(4))
def test_dry_friction_and_as_much_again_holds_a_joint_whichever_way(monitor, config, joint):
    dry = (config.column('coulomb') / config.column('torque_per_ampere'))[joint]

    def stands(change):
        monitor.clear()
        current = lambda k: of(joint, dry * (-0.5 + change * min((k - 1) / 100.0, 1.0)))  # noqa: E731
        return first_fault(monitor, 300, lambda k: 0.002 * (k == 1), current)[0] == ''

    assert stands(3.9)
    assert not stands(5.5)


def test_the_braking_current_of_a_joint_ends_when_it_rests(monitor):
    def rest_after(braking, rest):
        monitor.clear()
        return first_fault(
            monitor,
            120,
            lambda k: 0.002 * min(k, 20),
            lambda k: braking if k <= 20 else rest(k - 21),
        )[0]

    assert rest_after(9.0, lambda cycle: 0.0) == ''
    # It is gone in the first cycle at rest, not bit by bit, and explains no current that grows.
    assert 'does not move' in rest_after(9.0, lambda cycle: max(9.0 - 0.2 * cycle, 0.0))
    assert 'does not move' in rest_after(1.0, lambda cycle: 9.0)


@pytest.mark.parametrize('noise', [0.0, 4.0])
def test_counts_shake_a_joint_that_the_bridge_brakes(monitor, noise):
    current = lambda k: 3.0 * (k % 2) + 2.0  # noqa: E731
    found = first_fault(monitor, 200, still, current, noise=lambda k: [noise] * 4)
    assert (found[0] == '') == (noise > 0.0)


def test_the_noise_of_a_braked_joint_explains_its_current_after_it_came_to_rest(monitor):
    # Braked while it moves; at rest its current falls by what the counts had caused.
    found = first_fault(monitor, 200, lambda k: 0.002 * min(k, 20),
                        lambda k: 3.0 if k <= 20 else -1.0 if k == 21 else 3.0,
                        noise=lambda k: [6.0 * (k <= 20)] * 4)  # fmt: skip
    assert found[0] == ''


def test_feedback_that_turns_round_moves_a_joint_under_any_load(flying):
    current = lambda k: of(1, 2.0 if k <= 100 else -2.0)  # noqa: E731
    found = first_fault(flying, 200, lambda k: 0.002 * (k == 1), current)
    assert found[1] == pytest.approx(151, abs=1)


CURRENT, INERTIA = 3.0, 0.05  # [A], [kg m^2]


def driven(monitor, config, stuck_after=0.05, pause=0.0, noise=0.0, load=lambda time: 0.0):
    """Drive joint 4 from rest by a current; return the complaint and its time.

    The encoder sticks after a time [s], with a pause [s] there; the other joints rest.
    """
    joint = config.joints[3]
    rate = CURRENT * joint.torque_per_ampere / INERTIA / joint.gear.ratio  # [rad/s^2] motor side
    count = 2.0 * np.pi / 4096.0
    time, known = 0.0, {'noise': of(3, noise), 'inertias': [0.3, 0.3, 0.05, INERTIA]}
    while time < stuck_after + 0.04:
        time += pause if pause and stuck_after <= time < stuck_after + 0.0015 else 1e-3
        angle = np.floor(0.5 * rate * min(time, stuck_after) ** 2 / count) * count
        loads = of(3, load(time))
        text = check(monitor, of(3, angle), of(3, CURRENT), time, loads=loads, **known)
        if text:
            return text, time - stuck_after
    return '', np.inf


def test_an_encoder_that_sticks_at_constant_current_is_detected_by_the_expected_motion(
    monitor, config
):
    text, after = driven(monitor, config)
    assert text == (
        'joint4 does not move although its speed and its current of 3.0 A must have turned it: '
        'check for a stuck encoder or a blocked joint'
    )
    assert 2e-3 < after < 8e-3
    assert monitor.trusted.tolist() == [True, True, True, False]
    monitor.clear()
    assert driven(monitor, config, stuck_after=0.1)[1] > 0.0  # until then it is sound


@pytest.mark.parametrize(
    ('given', 'shortest', 'longest'),
    [
        ({'load': lambda torque: lambda time: 30.0 * torque * (time > 0.0505)}, np.inf, np.inf),
        ({'load': lambda torque: lambda time: 30.0 * torque}, 0.0, 8e-3),  # explains nothing
        ({'noise': 20.0 * CURRENT}, np.inf, np.inf),  # of a braked joint
        ({'pause': 8e-3}, 0.02, 0.035),  # from rest it takes 17 ms to have turned clearly
    ],
    ids=['changing load', 'constant load', 'noise', 'pause'],
)
def test_what_may_hold_a_joint_that_should_move(monitor, config, given, shortest, longest):
    torque = CURRENT * config.joints[3].torque_per_ampere
    given = {key: value(torque) if key == 'load' else value for key, value in given.items()}
    assert shortest <= driven(monitor, config, **given)[1] <= longest
