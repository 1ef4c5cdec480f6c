"""Fourier series, run-in and run-out, transfers, strokes and their sequence."""

from collections.abc import Callable

import numpy as np
import pytest
from derivatives import assert_derivatives_agree

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import (
    FourierTrajectory,
    MotionSequence,
    RampedExcitation,
    Stage,
    SteadyStroke,
    transfer,
)
from aerarm_ros.motion.polynomial_path import rest_to_rest_duration

STEP = 1e-4


def test_velocity_and_acceleration_are_the_derivatives(trajectory: FourierTrajectory) -> None:
    time = np.linspace(0.0, trajectory.period, 301)
    before, at, after = (trajectory.evaluate(time + d) for d in (-STEP, 0.0, STEP))
    velocity = (after.q - before.q) / (2.0 * STEP)
    acceleration = (after.dq - before.dq) / (2.0 * STEP)
    np.testing.assert_allclose(at.dq, velocity, atol=1e-6)
    np.testing.assert_allclose(at.ddq, acceleration, atol=1e-6)


def test_sine_and_cosine_enter_as_in_3_16() -> None:
    trajectory = FourierTrajectory(
        0.1, np.array([1.0]), np.array([[0.0, 0.3]]), np.array([[0.2, 0.0]])
    )
    time, w0 = 1.7, 0.2 * np.pi
    expected = 1.0 + 0.3 * np.sin(2 * w0 * time) + 0.2 * np.cos(w0 * time)
    assert trajectory.evaluate(time).q == pytest.approx([expected])
    assert trajectory.evaluate(0.0).dq == pytest.approx([0.3 * 2 * w0])


def test_repeats_after_a_period_and_holds_only_the_n_harmonics(
    trajectory: FourierTrajectory,
) -> None:
    time = np.arange(0.0, trajectory.period, 0.01)
    position = trajectory.evaluate(time).q
    a_period_later = trajectory.evaluate(time + trajectory.period).q
    np.testing.assert_allclose(a_period_later, position, atol=1e-12)
    spectrum = np.abs(np.fft.rfft(position, axis=0)) / len(time)
    assert spectrum[trajectory.harmonics + 1 :].max() < 1e-12
    np.testing.assert_allclose(spectrum[0], np.abs(trajectory.q0), atol=1e-12)
    assert trajectory.highest_frequency == pytest.approx(0.5)


RAMP = 2.0


@pytest.fixture
def ramped(trajectory: FourierTrajectory) -> RampedExcitation:
    return RampedExcitation(trajectory, periods=2, ramp_time=RAMP)


def test_position_velocity_and_acceleration_are_continuous(ramped: RampedExcitation) -> None:
    time = np.linspace(0.0, ramped.duration, 24001)
    states = ramped.evaluate(time)
    assert_derivatives_agree(time, states, of_position=1e-4, of_velocity=1e-2)
    for part in states[1:]:  # from rest to rest
        np.testing.assert_allclose(part[[0, -1]], 0.0, atol=1e-12)


def test_the_middle_is_whole_periods_of_the_trajectory(
    ramped: RampedExcitation, trajectory: FourierTrajectory
) -> None:
    assert ramped.periodic_duration == pytest.approx(20.0)
    time = np.linspace(0.0, ramped.periodic_duration, 501)
    played, wanted = ramped.evaluate(RAMP + time), trajectory.evaluate(time)
    for a, b in zip(played, wanted, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_ramps_stay_on_the_trajectory_and_below_its_speed(
    ramped: RampedExcitation, trajectory: FourierTrajectory
) -> None:
    period = trajectory.evaluate(np.linspace(0.0, trajectory.period, 20001))
    ramp = ramped.evaluate(np.linspace(0.0, RAMP, 101))
    for posture in ramp.q:
        assert np.abs(period.q - posture).max(axis=1).min() < 2e-3
    assert (np.abs(ramp.dq).max(axis=0) <= np.abs(period.dq).max(axis=0) + 1e-9).all()


def test_goes_from_rest_to_rest() -> None:
    start, end = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 4))
    way = transfer(start, end, 1.7)
    assert way.duration == 1.7
    for time, posture in ((0.0, start), (1.7, end)):
        for reached, wanted in zip(way.evaluate(time), (posture, 0.0, 0.0), strict=True):
            np.testing.assert_allclose(reached, wanted, atol=1e-12)


@pytest.mark.parametrize('travel', [0.05, 0.7, 3.0])
def test_the_peaks_reach_the_limits_exactly(travel: float) -> None:
    start, end = np.zeros(2), np.array([travel, -0.3 * travel])
    velocity, acceleration = np.array([1.0, 0.8]), np.array([2.0, 3.0])
    duration = rest_to_rest_duration(end - start, velocity, acceleration, minimum=0.01)
    reference = transfer(start, end, duration).evaluate(np.linspace(0.0, duration, 2001))
    used = max(
        (np.abs(reference.dq).max(axis=0) / velocity).max(),
        (np.abs(reference.ddq).max(axis=0) / acceleration).max(),
    )
    assert used == pytest.approx(1.0, abs=1e-3)


A, B, C = np.zeros(2), np.array([1.0, -1.0]), np.array([0.5, 0.5])


def leg(name: str, start: np.ndarray, end: np.ndarray, duration: float) -> Stage:
    return Stage(name, transfer(start, end, duration))


def still(count: int = 1, value: float = 0.0) -> FourierTrajectory:
    return FourierTrajectory(0.1, np.zeros(1), np.full((1, count), value), np.zeros((1, 1)))


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: FourierTrajectory(0.0, np.zeros(1), *np.zeros((2, 1, 1))), 'fundamental'),
        (lambda: FourierTrajectory(np.nan, np.zeros(1), *np.zeros((2, 1, 1))), 'fundamental'),
        (lambda: FourierTrajectory(0.1, np.zeros(2), *np.zeros((2, 1, 1))), '2 joints'),
        (lambda: FourierTrajectory(0.1, np.zeros(1), *np.zeros((2, 1, 0))), 'at least one'),
        (lambda: still(2), 'the same shape'),
        (lambda: still(value=np.nan), 'finite'),
        (lambda: RampedExcitation(still(), 0, 1.0), 'period'),
        (lambda: RampedExcitation(still(), 1.5, 1.0), 'period'),
        (lambda: RampedExcitation(still(), 1, 0.0), 'ramp'),
        (lambda: transfer(A, B, 0.0), 'duration'),
        (lambda: transfer(A, B, np.nan), 'duration'),
        (lambda: transfer(A, np.inf * B, 1.0), 'finite'),
        (lambda: MotionSequence([]), 'at least one'),
        (
            lambda: MotionSequence([leg('out', A, B, 1.0), leg('on', C, A, 2.0)]),
            'on does not start where out ends',
        ),
        (lambda: SteadyStroke(A, 0, 0.5, 2.0, 4.0), r'too short for 2 rad/s'),
    ],
)
def test_impossible_motions_are_refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises(ExcitationError, match=message):
        make()


def test_stages_follow_each_other() -> None:
    motion = MotionSequence([leg('out', A, B, 1.0), leg('on', B, C, 2.0)])
    assert motion.duration == 3.0
    assert [motion.stage_at(t).name for t in (0.0, 0.99, 1.0, 5.0)] == ['out', 'out', 'on', 'on']
    np.testing.assert_allclose(motion.evaluate(1.0).q, B)
    np.testing.assert_allclose(motion.evaluate(9.0).q, C)


START = np.array([0.1, 1.5, -0.2])


@pytest.mark.parametrize('travel', [1.2, -1.2])
def test_velocity_is_constant_between_the_ramps(travel: float) -> None:
    stroke = SteadyStroke(START, 1, travel, speed=0.8, acceleration=4.0)
    time = np.linspace(0.0, stroke.duration, 4001)
    q, dq, ddq = stroke.evaluate(time)
    steady = (time >= stroke.ramp_time) & (time <= stroke.ramp_time + stroke.steady_time)
    np.testing.assert_allclose(dq[steady, 1], np.sign(travel) * 0.8, atol=1e-12)
    assert np.abs(ddq).max() == pytest.approx(4.0, rel=1e-3)
    np.testing.assert_array_equal(q[:, [0, 2]], np.tile(START[[0, 2]], (len(time), 1)))
    np.testing.assert_allclose(q[-1, 1], START[1] + travel, atol=1e-12)
    np.testing.assert_allclose(np.gradient(q[:, 1], time), dq[:, 1], atol=2e-3)
    np.testing.assert_allclose(np.gradient(dq[:, 1], time)[1:-1], ddq[1:-1, 1], atol=2e-2)
