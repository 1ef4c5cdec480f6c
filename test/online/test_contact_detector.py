"""Contact of the emulated arm in motion and at rest, with payload and with bad input."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from carrying_run import CarryingRun
from touched_run import GAIN, SMALL, Touch, detector, known_arm, learnt, recording

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.contact_detector import Cause, ContactDetector
from aerarm_ros.online.external_torque import ExternalTorque, ResidualBound, free_rows
from aerarm_ros.online.joint_friction import JointFriction

TOUCH = Touch(1.6, 2.3, (0.0, 0.0, -5.0))


def play(found: ContactDetector, motion: Recording) -> ContactDetector:
    assert motion.dq is not None
    for time, q, dq, tau in zip(motion.time, motion.q, motion.dq, motion.tau, strict=True):
        found.update(ArmState(q, dq, tau), float(time))
    return found


def test_another_free_motion_has_no_contact(run: CarryingRun, bound: ResidualBound) -> None:
    assert play(detector(run, bound), recording(run, 0.7, run.pick_up)).events == []


@pytest.mark.parametrize('direction', [(0, 0, -1), (1, 0, 0), (0, 1, 0)])
def test_a_touch_in_motion_is_found_within_a_tenth_of_a_second(
    direction: tuple[int, int, int], run: CarryingRun, bound: ResidualBound
) -> None:
    x, y, z = (5.0 * value for value in direction)
    motion = replace(TOUCH, force=(x, y, z)).added(run, recording(run, 0.7, run.pick_up))
    (event,) = play(detector(run, bound), motion).events
    assert event.cause is Cause.CONTACT
    assert 0.0 < event.begin - TOUCH.begin < 0.1
    assert -0.05 < event.end - TOUCH.end < 0.35


def at_rest(run: CarryingRun, push: float) -> Recording:
    """Return 4 s of rest with a push at 2 to 3 s, as a share of dry friction, and drive noise."""
    arm = known_arm(run)
    robot, noise = arm.robot, np.random.default_rng(1)
    q = np.array([0.3, 0.8, -0.5, 0.4])
    holding = ExternalTorque(arm, GAIN).dynamics.gravity(q) + 0.3 * arm.friction[1]
    time = np.arange(0.0, 4.0, 1e-3)
    tau = holding + 1e-3 * noise.standard_normal((len(time), robot.n))
    rising = np.clip((time - 2.0) / 0.1, 0.0, 1.0) * (time < 3.0)
    tau -= push * arm.friction[1] * rising[:, np.newaxis]
    return Recording('rest', robot.joint_names, time, np.tile(q, (len(time), 1)),
                     np.zeros((len(time), robot.n)), tau, np.zeros(4, bool))  # fmt: skip


def clamped(motion: Recording) -> Recording:
    """Return a rest whose push stays."""
    after = motion.time > 2.9
    tau = motion.tau.copy()
    tau[after] = tau[2899] + motion.tau[after] - motion.tau[after].mean(axis=0)
    return replace(motion, tau=tau)


@pytest.fixture
def quiet(run: CarryingRun, bound: ResidualBound) -> ContactDetector:
    return detector(run, replace(bound, noise=np.full(4, 1e-4)))


def with_a_late_state_and_a_gap(motion: Recording) -> Recording:
    order = np.arange(len(motion.time))
    order[[3000, 3010]] = 3010, 3000
    kept = (motion.time < 3.2) | (motion.time > 3.7)
    return thinned(motion, order[kept[order]])


@pytest.mark.parametrize(
    ('change', 'is_lasting'),
    [
        (lambda motion: motion, False),
        (clamped, True),
        (lambda motion: with_a_late_state_and_a_gap(clamped(motion)), True),
    ],
)
def test_at_rest_a_push_counts_until_it_ends(
    run: CarryingRun,
    quiet: ContactDetector,
    change: Callable[[Recording], Recording],
    is_lasting: bool,
) -> None:
    (event,) = play(quiet, change(at_rest(run, 0.6))).events
    assert event.cause is Cause.CONTACT
    assert 2.0 < event.begin < 2.1
    assert np.isnan(event.end) if is_lasting else 3.0 < event.end < 3.4


def test_an_invalid_state_ends_no_contact(run: CarryingRun, quiet: ContactDetector) -> None:
    play(quiet, thinned(at_rest(run, 0.6), np.arange(2500)))
    nothing = np.full(4, np.nan)
    report = quiet.update(ArmState(nothing, nothing, nothing), 2.5005)
    assert report is not None
    assert report.in_contact
    assert quiet.update(ArmState(nothing, nothing, nothing), 4.0) is None


def test_a_clock_that_is_set_back_starts_the_detection_again(
    run: CarryingRun, quiet: ContactDetector
) -> None:
    assert play(quiet, at_rest(run, 0.0)).events == []  # drive noise is no contact
    (event,) = play(quiet, at_rest(run, 0.6)).events
    assert event.begin == pytest.approx(2.05, abs=0.05)


def test_states_lost_in_bursts_are_reported(run: CarryingRun, quiet: ContactDetector) -> None:
    motion = at_rest(run, 0.6)
    kept = np.arange(len(motion.time)) % 9 < 4
    assert 'too many joint states are lost' in play(quiet, thinned(motion, kept)).problem
    assert play(quiet, replace(motion, time=motion.time + 10.0)).problem == ''


def slow_motion(run: CarryingRun, rest: float) -> Recording:
    """Return rest, in which friction holds a torque, then 12 s of slow motion of an exact model."""
    arm = known_arm(run)
    model = ExternalTorque(arm, GAIN).dynamics.fixed
    time = np.arange(-rest, 12.0, 1e-3)
    phase = np.clip(time, 0.0, None)[:, np.newaxis]
    turns = np.array([0.6, 0.8, 1.0, 1.2])
    amplitude = 0.5 * np.minimum(phase, 1.0)
    q = np.array([0.3, 0.8, -0.5, 0.4]) + amplitude * np.sin(turns * phase)
    dq, ddq = np.gradient(q, 1e-3, axis=0), np.gradient(np.gradient(q, 1e-3, axis=0), 1e-3, axis=0)
    friction = JointFriction(arm)
    tau = np.array([
        model.inverse(*state) + friction.torque(state[1], model.bias(*state[:2]))
        for state in zip(q, dq, ddq, strict=True)
    ])  # fmt: skip
    tau[time < 0.0] += 0.9 * arm.friction[1]
    tau += 1e-3 * np.random.default_rng(2).standard_normal(q.shape)
    return Recording('slow', arm.robot.joint_names, time, q, dq, tau, np.zeros(4, bool))


@pytest.mark.parametrize('force', [0.6, 1.5])
def test_a_push_from_rest_into_motion_ends_when_it_ends(
    force: float, run: CarryingRun, quiet: ContactDetector
) -> None:
    push = Touch(-1.0, 3.0, (force, force, force))
    (event,) = play(quiet, push.added(run, slow_motion(run, 2.0))).events
    assert event.begin == pytest.approx(push.begin, abs=0.1)
    assert event.end == pytest.approx(push.end, abs=0.3)


def test_a_wrong_model_and_a_hanging_encoder_are_no_contact(
    run: CarryingRun, bound: ResidualBound
) -> None:
    motion = recording(run, 0.7, run.pick_up)
    found = play(detector(run, bound), replace(motion, tau=motion.tau + 2.0))
    assert {event.cause for event in found.events} == {Cause.MODEL}
    assert 'check that the model belongs to this arm' in found.problem
    q = motion.q.copy()
    q[500:] = q[500]
    found = play(detector(run, bound), replace(motion, q=q))
    assert 'check the encoder' in found.problem
    assert found.event is None


def test_a_declared_payload_is_neither_contact_nor_found(
    loaded: CarryingRun, bound: ResidualBound
) -> None:
    found = play(detector(loaded, bound), recording(loaded, 0.7, loaded.pick_up))
    found.carry(loaded.payload)
    play(found, recording(loaded, loaded.pick_up, 7.5))
    assert found.events == []
    assert found.payload_mass is None


def test_a_declared_payload_widens_the_thresholds(
    loaded: CarryingRun, bound: ResidualBound
) -> None:
    """Torque constants and friction are less accurate under load."""
    bare, carrying = detector(loaded, bound), detector(loaded, bound)
    carrying.carry(loaded.payload)
    motion = recording(loaded, loaded.pick_up, 4.0)
    assert motion.dq is not None
    for time, q, dq, tau in zip(motion.time, motion.q, motion.dq, motion.tau, strict=True):
        state = ArmState(q, dq, tau)
        reports = [found.update(state, float(time)) for found in (bare, carrying)]
    low, high = (report.threshold for report in reports if report is not None)
    assert (high - low).max() > 0.01


def test_a_saturated_torque_is_named_and_no_contact(run: CarryingRun, bound: ResidualBound) -> None:
    motion = recording(run, 0.7, run.pick_up)
    largest = 0.5 * np.abs(motion.tau).max(axis=0)
    found = ContactDetector(ExternalTorque(known_arm(run), GAIN), bound, SMALL, largest)
    clipped = replace(motion, tau=np.clip(motion.tau, -largest, largest))
    saturated = np.flatnonzero((np.abs(clipped.tau) == largest).any(axis=1))
    play(found, thinned(clipped, np.arange(saturated[-1] + 1)))
    assert 'is at its limit' in found.problem
    assert found.events == []


def test_a_contact_lasts_while_the_torque_saturates(run: CarryingRun, bound: ResidualBound) -> None:
    motion = TOUCH.added(run, recording(run, 0.7, run.pick_up))
    limit = np.full(4, 1e3)
    found = ContactDetector(ExternalTorque(known_arm(run), GAIN), bound, SMALL, limit)
    tau = motion.tau.copy()
    tau[(motion.time > 1.7) & (motion.time < 2.2)] = limit
    play(found, replace(motion, tau=tau))
    (event,) = found.events
    assert event.begin == pytest.approx(TOUCH.begin, abs=0.1)
    assert event.end > 2.2


@pytest.mark.parametrize('lost', [8, 60])
def test_lost_states_find_nothing_and_end_no_contact(
    run: CarryingRun, bound: ResidualBound, lost: int
) -> None:
    motion = recording(run, 0.7, run.pick_up)
    kept = np.ones(len(motion.time), bool)
    for begin in range(300, len(kept), 200):
        kept[begin : begin + lost] = False
    tau = motion.tau.copy()
    tau[::7] = np.nan
    time = motion.time + np.where(np.arange(len(motion.time)) > 900, 3.0, 0.0)
    for free in (thinned(motion, kept), replace(motion, tau=tau, time=time)):
        assert play(detector(run, bound), free).events == []
    (event,) = play(detector(run, bound), thinned(TOUCH.added(run, motion), kept)).events
    assert event.cause is Cause.CONTACT
    assert event.end - event.begin > 0.8 * (TOUCH.end - TOUCH.begin)


def thinned(motion: Recording, kept: np.ndarray) -> Recording:
    """Return a recording without some states."""
    assert motion.dq is not None
    rows = {name: getattr(motion, name)[kept] for name in ('time', 'q', 'dq', 'tau')}
    return replace(motion, **rows)


def test_thresholds_survive_their_file(run: CarryingRun, bound: ResidualBound) -> None:
    names = run.robot().joint_names
    again = ResidualBound.from_dict(bound.to_dict(names), names, 'file')
    np.testing.assert_allclose(again.shares, bound.shares, atol=1e-6)
    assert again.gain == bound.gain


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'features': []}, 'contains no thresholds of contact detection'),
        ({'joint_names': ['a']}, 'contains thresholds for the joints'),
        ({'shares': [[1.0]]}, 'is missing or is not a number'),
        ({'noise': [0.1, 0.1, 0.1, -0.1]}, 'finite and not negative'),
        ({'observer_gain': 0.0}, 'finite and not negative'),
    ],
)
def test_a_wrong_file_is_rejected(
    change: dict, words: str, run: CarryingRun, bound: ResidualBound
) -> None:
    names = run.robot().joint_names
    with pytest.raises(ValueError, match=words):
        ResidualBound.from_dict({**bound.to_dict(names), **change}, names, 'file')


def test_lost_states_do_not_raise_the_thresholds(free: CarryingRun, bound: ResidualBound) -> None:
    motion = recording(free, 0.7, 9.0)
    kept = np.ones(len(motion.time), bool)
    for begin in range(300, len(kept), 200):
        kept[begin : begin + 20] = False
    again = learnt(free, thinned(motion, kept))
    rows = list(free_rows(ExternalTorque(known_arm(free), GAIN), motion))
    once, later = (
        np.mean([each.threshold(row) for row in rows], axis=0) for each in (bound, again)
    )
    assert (later < 1.3 * once).all()


def test_too_little_free_motion_is_rejected(free: CarryingRun) -> None:
    with pytest.raises(IdentificationError, match='too few to learn thresholds'):
        learnt(free, recording(free, 0.7, 1.0))


def test_a_payload_is_reported_subtracted_and_released(
    loaded: CarryingRun, free: CarryingRun, bound: ResidualBound
) -> None:
    found = play(detector(loaded, bound), recording(loaded, 0.7, 7.5))
    event = found.events[-1]
    assert event.cause is Cause.PAYLOAD
    assert event.begin > loaded.pick_up
    assert found.event is None
    assert found.payload_mass == pytest.approx(0.2, rel=0.25)
    motion = recording(free, 0.7, 5.0)
    play(found, replace(motion, time=motion.time + 10.0))
    assert found.payload_mass is None
    assert found.events[-1].cause is Cause.RELEASED
    assert found.event is None


def moved(motion: Recording, run: CarryingRun, begin: float) -> Recording:
    """Return a rest that continues in another posture after `begin` [s], with friction reversed."""
    after = motion.time >= begin
    dynamics, dry = ExternalTorque(known_arm(run), GAIN).dynamics, known_arm(run).friction[1]
    q, tau = motion.q.copy(), motion.tau.copy()
    before, q[after] = q[0], q[after] + 0.1
    tau[after] += dynamics.gravity(q[-1]) - dynamics.gravity(before) - 0.6 * dry
    return replace(motion, q=q, tau=tau)


def test_saturation_while_the_posture_changes_is_no_contact(
    run: CarryingRun, bound: ResidualBound
) -> None:
    motion = moved(at_rest(run, 0.0), run, 2.0)
    limit = np.full(4, 50.0)
    motion.tau[(motion.time > 1.5) & (motion.time < 2.4)] = limit
    found = ContactDetector(ExternalTorque(known_arm(run), GAIN), bound, SMALL, limit)
    assert play(found, motion).events == []


def test_after_a_short_gap_a_push_is_contact_and_after_a_long_one_it_may_be_a_load(
    run: CarryingRun, bound: ResidualBound
) -> None:
    motion = TOUCH.added(run, recording(run, 0.7, run.pick_up))
    kept = (motion.time < TOUCH.begin - 0.1) | (motion.time > TOUCH.begin + 0.1)
    for pause, cause in ((0.0, Cause.CONTACT), (5.0, Cause.MODEL)):
        later = motion.time + np.where(motion.time > TOUCH.begin, pause, 0.0)
        events = play(detector(run, bound), thinned(replace(motion, time=later), kept)).events
        assert [event.cause for event in events] == [cause]
