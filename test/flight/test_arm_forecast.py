"""The joints' forecast: as planned if the arm follows the plan, otherwise as measured."""

import numpy as np
import pytest

from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.flight.arm_load import ArmForecast
from aerarm_ros.motion.signals import JointReference

TIMES = np.linspace(0.0, 0.1, 6)
LEAD = 0.03
W = 2.0 * np.pi * np.array([0.5, 0.6, 0.75, 0.9])
AMPLITUDE = np.array([0.5, 0.8, 0.6, 0.7])


def swing(time: float | np.ndarray) -> JointReference:
    t = np.asarray(time)[..., np.newaxis]
    s, c = np.sin(W * t), np.cos(W * t)
    return JointReference(AMPLITUDE * s, AMPLITUDE * W * c, -AMPLITUDE * W**2 * s)


def off(motion: JointReference, angle: float) -> JointReference:
    return motion._replace(q=motion.q + angle)


@pytest.fixture
def forecast() -> ArmForecast:
    return ArmForecast(4, LEAD)


def run(forecast: ArmForecast, begin: float, end: float, plans: bool, error: float = 0.0):
    """Yield time and forecast of a swinging arm, a millisecond at a time."""
    for cycle in range(round(1e3 * begin), round(1e3 * end)):
        now = 1e-3 * cycle
        if plans and cycle % 10 == 0:
            forecast.offer(now, TIMES, *swing(now + TIMES))
        yield now, forecast.motion(now, off(swing(now), error))


def test_a_plan_predicts_the_motion_exactly(forecast: ArmForecast) -> None:
    for now, told in run(forecast, 0.0, 0.5, plans=True, error=0.02):
        # A lasting error of the joints goes on.
        np.testing.assert_allclose(told.q, swing(now + LEAD).q + 0.02, atol=1e-7)
        np.testing.assert_allclose(told.dq, swing(now + LEAD).dq, atol=1e-5)
        np.testing.assert_allclose(told.ddq, swing(now + LEAD).ddq, atol=2e-3)
    assert forecast.problem == ''


def test_without_a_plan_the_measured_motion_is_extrapolated(forecast: ArmForecast) -> None:
    for now, told in run(forecast, 0.0, 0.1, plans=False):
        seen = swing(now)
        np.testing.assert_allclose(told.q, seen.q + LEAD * seen.dq)
        np.testing.assert_allclose(told.dq, seen.dq)
        np.testing.assert_allclose(told.ddq, seen.ddq)
    assert forecast.problem == 'no plan'


def test_the_measured_motion_of_an_arm_that_is_not_held_fades(forecast: ArmForecast) -> None:
    list(run(forecast, 0.0, 0.1, plans=False))
    forecast.is_held = False
    rows = [told for _, told in run(forecast, 0.1, 0.2, plans=False)]
    assert np.abs(np.diff([told.dq for told in rows], axis=0)).max() < 0.1  # no step
    last = rows[-1]
    np.testing.assert_allclose(last.q, swing(0.199).q)
    np.testing.assert_array_equal([last.dq, last.ddq], 0.0)
    forecast.is_held = True
    *_, (now, told) = run(forecast, 0.2, 0.3, plans=False)
    np.testing.assert_allclose(told.ddq, swing(now).ddq)


def test_a_plan_that_ends_or_comes_fades(forecast: ArmForecast) -> None:
    rows = [
        told.ddq
        for begin, end, plans in ((0.0, 0.2, True), (0.2, 0.5, False), (0.5, 0.7, True))
        for _, told in run(forecast, begin, end, plans)
    ]
    # Between a plan and a measurement that is older by the lead: within 50 ms, no step.
    late = np.abs(swing(0.0).ddq - swing(LEAD).ddq).max()
    assert late > 0.3
    jerk = AMPLITUDE * W**3
    assert np.all(np.abs(np.diff(rows, axis=0)) < 1e-3 * jerk + 0.1 * late)
    assert forecast.problem == ''


def test_a_plan_that_the_arm_does_not_follow_is_not_used(forecast: ArmForecast) -> None:
    blocked = JointReference.at_rest(swing(0.0).q)
    for cycle in range(400):
        now = 1e-3 * cycle
        if cycle % 10 == 0:
            forecast.offer(now, TIMES, *swing(now + TIMES))
        told = forecast.motion(now, blocked)
    np.testing.assert_allclose(told.ddq, 0.0)
    assert 'planned' in forecast.problem


def test_after_a_gap_an_old_plan_is_not_used(forecast: ArmForecast) -> None:
    list(run(forecast, 0.0, 0.1, plans=True))
    told = forecast.motion(100.0, JointReference.at_rest(np.ones(4)))
    np.testing.assert_array_equal(told.q, 1.0)
    assert forecast.problem == 'the plan does not cover this time'


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (lambda t, q, dq, ddq: (t[:1], q[:1], dq[:1], ddq[:1]), 'two points or more'),
        (lambda t, q, dq, ddq: (t, q, dq, np.zeros((0,))), 'positions, velocities'),
        (
            lambda t, q, dq, ddq: (t, q[:, :3], dq[:, :3], ddq[:, :3]),
            'each point needs values of 4 joints',
        ),
        (lambda t, q, dq, ddq: (t, q * np.nan, dq, ddq), 'finite'),
        (lambda t, q, dq, ddq: (t[::-1], q, dq, ddq), 'increase from 0'),
        (lambda t, q, dq, ddq: (200.0 * t, q, dq, ddq), '10 s at most'),
    ],
)
def test_an_invalid_plan_is_rejected_without_effect(
    forecast: ArmForecast, change, reason: str
) -> None:
    forecast.offer(0.0, TIMES, *swing(TIMES))
    with pytest.raises(RejectedInputError, match=reason):
        forecast.offer(0.0, *change(TIMES, *swing(TIMES)))
    told = forecast.motion(0.0, swing(0.0))
    np.testing.assert_allclose(told.q, swing(LEAD).q, atol=1e-7)
