"""Playing to an ideal, a drifting, a blocked and a silent arm."""

import numpy as np
import pytest

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.feasibility import StopLimits
from aerarm_ros.excitation.player import ExcitationPlayer, FeedForwardLaw, PlayState, VelocityLaw
from aerarm_ros.excitation.settings import ExcitationError, MotionLimits
from aerarm_ros.excitation.trajectory import (
    FourierTrajectory,
    MotionSequence,
    RampedExcitation,
    Stage,
)
from aerarm_ros.motion.signals import JointReference

STOPS = StopLimits(MotionLimits.of_arm(load_arm_config()), None)
MILLISECOND = 1_000_000


@pytest.fixture
def motion(trajectory: FourierTrajectory) -> MotionSequence:
    return MotionSequence([Stage('excitation', RampedExcitation(trajectory, 1, 1.0))])


def play(player: ExcitationPlayer, q: np.ndarray, bias: float = 0.0, blocked: bool = False):
    """Integrate velocity commands as an arm with a velocity bias would; yield (stamp, q)."""
    stamp = 5_000_000_000
    while not player.done:
        command = player.update(stamp, q)
        yield stamp, q, command
        if not blocked:
            q = q + 1e-3 * (command.dq + bias)
        stamp += MILLISECOND


def test_an_ideal_arm_ends_where_the_motion_ends(motion: MotionSequence) -> None:
    player = ExcitationPlayer(motion, VelocityLaw(0.0), STOPS)
    *_, (_, q, command) = play(player, motion.evaluate(0.0).q)
    assert player.state is PlayState.FINISHED
    assert player.progress == 1.0
    # Explicit Euler: half a cycle behind wherever it moves, and nothing left at rest.
    np.testing.assert_allclose(q, motion.evaluate(motion.duration).q, atol=1e-6)
    np.testing.assert_allclose(command.dq, 0.0, atol=1e-9)


def test_before_the_motion_commands_hold_the_arm_at_its_start(motion: MotionSequence) -> None:
    player = ExcitationPlayer(motion, VelocityLaw(1.0), STOPS)
    beside = motion.evaluate(0.0).q + 0.01
    for _ in range(2):
        held = player.hold(beside)
    begun = player.update(5_000_000_000, beside)
    np.testing.assert_array_equal(held.dq, begun.dq)
    assert np.all(held.dq < 0.0)
    with pytest.raises(ExcitationError, match='moved by 1.000 rad'):
        player.hold(motion.evaluate(0.0).q + 1.0)
    with pytest.raises(ExcitationError, match='NaN'):
        player.hold(beside * np.nan)


def test_a_small_gain_bounds_the_drift(motion: MotionSequence) -> None:
    drift = 0.02
    errors = {}
    for gain in (0.0, 1.0):
        player = ExcitationPlayer(motion, VelocityLaw(gain), STOPS)
        for _ in play(player, motion.evaluate(0.0).q, bias=drift):
            pass
        errors[gain] = player.largest_error.max()
    assert errors[0.0] == pytest.approx(drift * motion.duration, rel=0.05)
    assert errors[1.0] < 1.1 * drift


def test_lost_messages_do_not_distort_the_motion(motion: MotionSequence) -> None:
    law = VelocityLaw(0.0)
    every, some = (ExcitationPlayer(motion, law, STOPS) for _ in range(2))
    for stamp in range(0, 3000 * MILLISECOND, MILLISECOND):
        full = every.update(stamp, motion.evaluate(stamp * 1e-9).q)
        if stamp // MILLISECOND % 7 == 0:
            sparse = some.update(stamp, motion.evaluate(stamp * 1e-9).q)
            np.testing.assert_array_equal(sparse.dq, full.dq)


def test_a_stop_comes_to_rest_on_the_path_without_a_jump(motion: MotionSequence) -> None:
    player = ExcitationPlayer(motion, VelocityLaw(0.0), STOPS)
    braking = np.abs(motion.evaluate(np.arange(0.0, 6.0, 1e-3)).dq) / STOPS.limits.acceleration
    hardest = int(braking.max(axis=1).argmax())
    velocity = []
    for _, _, command in play(player, motion.evaluate(0.0).q):
        velocity.append(command.dq)
        if len(velocity) == hardest:
            player.stop()
    assert player.state is PlayState.STOPPED
    assert player.fault is None
    np.testing.assert_allclose(velocity[-1], 0.0, atol=1e-9)
    accelerations = np.abs(np.diff(velocity, axis=0)) / 1e-3
    assert np.all(accelerations < 1.001 * STOPS.limits.acceleration)
    assert accelerations[hardest:].max(axis=0)[braking.max(axis=0).argmax()] > 10.0
    assert len(velocity) - hardest < 200  # cycles


def test_a_blocked_arm_ends_the_motion_and_names_the_joint(motion: MotionSequence) -> None:
    player = ExcitationPlayer(motion, VelocityLaw(1.0), STOPS, tracking_limit=0.2)
    for _ in play(player, motion.evaluate(0.0).q, blocked=True):
        pass
    assert player.state is PlayState.STOPPED
    assert 'joint' in player.fault
    assert 'tracking_limit' in player.fault


def test_jumping_stamps_moved_arms_and_nan_are_refused(motion: MotionSequence) -> None:
    q = motion.evaluate(0.0).q
    for first, then, message in (
        (q, (10**9 - MILLISECOND, q), 'stamps jump'),
        (q, (10**9 + 200 * MILLISECOND, q), 'stamps jump'),
        (None, (0, q + [0.0, 0.0, 0.06, 0.0]), 'joint3 moved by 0.060 rad after'),
        (None, (0, np.full(4, np.nan)), 'NaN'),
    ):
        player = ExcitationPlayer(motion, VelocityLaw(1.0), STOPS)
        if first is not None:
            player.update(10**9, first)
        with pytest.raises(ExcitationError, match=message):
            player.update(*then)
    player = ExcitationPlayer(motion, VelocityLaw(1.0), STOPS)
    assert player.update(0, q + [0.0, 0.0, 0.04, 0.0]).dq is not None


def test_feed_forward_commands_all_three(motion: MotionSequence, setup: ExcitationSetup) -> None:
    model = setup.effort_model
    player = ExcitationPlayer(motion, FeedForwardLaw(model), STOPS)
    player.update(0, motion.evaluate(0.0).q)
    for stamp in range(0, 2_000 * MILLISECOND, 50 * MILLISECOND):
        command = player.update(stamp, motion.evaluate(stamp * 1e-9).q)
    reference = motion.evaluate(stamp * 1e-9)
    np.testing.assert_allclose(command.q, reference.q)
    np.testing.assert_allclose(command.dq, reference.dq)
    np.testing.assert_allclose(
        command.tau, model.effort(*(part[np.newaxis] for part in reference))[0]
    )


def test_the_forecast_equals_the_later_commands(motion: MotionSequence) -> None:
    player = ExcitationPlayer(motion, VelocityLaw(0.0), STOPS)
    times = np.linspace(0.0, 0.1, 6)
    assert player.ahead(times) is None
    told: dict[int, np.ndarray] = {}
    for stamp, _, command in play(player, motion.evaluate(0.0).q):
        if stamp in told:
            np.testing.assert_allclose(command.dq, told.pop(stamp), atol=1e-9)
        elif not told:
            ahead = player.ahead(times)
            assert ahead is not None
            stamps = [stamp + round(1e9 * time) for time in times.tolist()]
            told = dict(zip(stamps[1:], ahead.dq[1:], strict=True))
        if stamp == 5_700_000_000:
            player.stop()  # which no plan of before knows
            told = {}
    assert player.done


REFERENCE = JointReference(*np.random.default_rng(0).normal(size=(3, 4)))


def test_the_corrected_velocity_never_exceeds_the_limit() -> None:
    limit = np.full(4, 2.5)
    far = REFERENCE.q - np.array([3.0, -3.0, 3.0, 0.0])
    command = VelocityLaw(20.0, limit).command(REFERENCE, far)
    np.testing.assert_array_equal(command.dq[:3], [2.5, -2.5, 2.5])
    assert command.dq[3] == REFERENCE.dq[3]
