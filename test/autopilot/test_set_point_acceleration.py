"""Tilt ahead of the arm's force: derivatives of the tilt, and its limits."""

import numpy as np
import pytest

from aerarm_ros.autopilot.set_point_acceleration import SetPointAcceleration
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.arm_load import FeedForward, MassProperties

BODY = MassProperties(4.5, np.zeros(3), np.diag([0.2, 0.3, 0.1]))
LEVEL = np.eye(3)
H = 1e-3  # [s]


def force(time: float) -> np.ndarray:
    """Return a force with a large vertical part, of one frequency in all axes [N]."""
    s, c = np.sin(4.0 * time), np.cos(4.0 * time)
    return np.array([4.0 * s, 3.0 * c, 9.0 * s])


def arm(time: float) -> FeedForward:
    before, now, after = (force(time + step) for step in (-H, 0.0, H))
    rate, curvature = (after - before) / (2.0 * H), (after - 2.0 * now + before) / H**2
    return FeedForward(BODY, np.r_[now, 0, 0, 0], np.r_[now, 0, 0, 0], rate, curvature)


def tilt(time: float) -> np.ndarray:
    """Return the tilt of a thrust that carries the weight and the force."""
    f = force(time)
    return -f[:2] / (BODY.mass * GRAVITY - f[2])


@pytest.mark.parametrize('time', [0.0, 0.13, 0.4, 0.9])
def test_the_tilt_leads_by_its_derivatives(time: float) -> None:
    gain, rate_gain = 5.0, 8.0
    ahead = SetPointAcceleration(gain, rate_gain)
    found = ahead.update(arm(time), LEVEL, 0.0)[:2] / GRAVITY
    speed = (tilt(time + H) - tilt(time - H)) / (2.0 * H)
    bend = (tilt(time + H) - 2.0 * tilt(time) + tilt(time - H)) / H**2
    # A tilt along x is a rotation about y.
    inertia = np.array([BODY.inertia[1, 1], BODY.inertia[0, 0]])
    # The moment by which the lift balances the wrench at the centre is zero here.
    wanted = tilt(time) + (speed + inertia * bend / rate_gain) / gain
    np.testing.assert_allclose(found, wanted, atol=2e-4)


def test_with_regard_to_the_lift_the_acceleration_is_that_of_the_force() -> None:
    found = SetPointAcceleration(ignores_lift=False).update(arm(0.4), LEVEL, 0.004)
    np.testing.assert_allclose(found, -force(0.4) / BODY.mass)


def test_the_tilt_is_limited_if_the_arm_carries_the_drone() -> None:
    lifted = FeedForward(BODY, np.r_[5.0, 0, 60.0, 0, 0, 0], np.zeros(6), np.zeros(3), np.zeros(3))
    x, _, z = SetPointAcceleration().update(lifted, LEVEL, 0.004)
    assert x == pytest.approx(-5.0 / (0.3 * BODY.mass))
    assert z == pytest.approx(-60.0 / BODY.mass)


def test_the_force_is_taken_back_along_the_heading() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    x, y, z = SetPointAcceleration().update(arm(0.4), quarter, 0.004)
    # The autopilot tilts by atan(a / g), and the rotors carry the weight without the arm's force.
    lift = BODY.mass * GRAVITY - force(0.4)[2]
    found = np.array([x / GRAVITY * lift, y / GRAVITY * lift, BODY.mass * z])
    np.testing.assert_allclose(found, quarter @ -force(0.4))


def test_what_lasts_is_left_to_the_integral() -> None:
    acceleration = SetPointAcceleration(7.0, 3.0, integral_rate=2.0)
    still, moved = (
        FeedForward.at_rest(MassProperties(4.5, np.array([x, 0.0, 0.0]), BODY.inertia))
        for x in (0.02, 0.04)
    )
    assert acceleration.update(still, LEVEL, 0.004) == pytest.approx(0.0)
    # The centre lies ahead: the nose would go down, so the thrust leans back.
    assert acceleration.update(moved, LEVEL, 0.004)[0] < -0.1
    for _ in range(1000):
        last = acceleration.update(moved, LEVEL, 0.004)
    assert abs(last[0]) < 1e-3
