"""A stroke has a part at exactly its speed, and its derivatives agree."""

import numpy as np
import pytest

from aerarm_ros.excitation.settings import ExcitationError
from aerarm_ros.excitation.trajectory import SteadyStroke

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


def test_scalar_time_and_the_ends_hold() -> None:
    stroke = SteadyStroke(START, 0, 1.0, 0.5, 2.0)
    one = stroke.evaluate(0.3)
    many = stroke.evaluate([0.3])
    for a, b in zip(one, many, strict=True):
        np.testing.assert_allclose(a, b[0], atol=1e-15)
    np.testing.assert_array_equal(stroke.evaluate(-1.0).q, START)
    np.testing.assert_array_equal(stroke.evaluate(99.0).dq, 0.0)


def test_a_stroke_too_short_for_its_ramps_is_rejected() -> None:
    with pytest.raises(ExcitationError, match=r'too short for 2 rad/s'):
        SteadyStroke(START, 0, 0.5, 2.0, 4.0)
