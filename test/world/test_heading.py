"""Heading of a drone under the moment of its arm."""

import numpy as np
import pytest

from aerarm_ros.world.heading import HeadingControl

LIMIT = np.radians(5.0)
TIMES = np.linspace(0.0, 2.0, 201)


def excursion(control: HeadingControl, turn: np.ndarray, room: float = np.inf) -> float:
    """Return the excursion for a drone and arm of 0.2 kg m^2 with L / I = `turn` (M,) [rad/s]."""
    inertia, most = np.full(len(turn), 0.2), np.full(len(turn), min(room, 1e9))
    return control.excursion(TIMES, 0.2 * turn, inertia, -most, most)


def pulse(speed: float) -> np.ndarray:
    return speed * np.sin(np.pi * TIMES / TIMES[-1]) ** 2


@pytest.mark.parametrize('is_fed', [False, True])
def test_without_moment_the_heading_follows_the_path_alone(is_fed: bool) -> None:
    """Angular momentum is conserved, so the heading turns by the integral of L / I."""
    turned = excursion(HeadingControl(LIMIT, 2.0, is_fed), pulse(0.5), room=0.0)
    assert turned == pytest.approx(0.5, rel=1e-3)


def test_the_response_is_that_of_the_linear_system() -> None:
    """psi'' + 2 zeta w psi' + w^2 psi = -d(L / I)/dt, solved by scipy."""
    from scipy.signal import lsim

    w = 2.0
    times = np.linspace(0.0, 4.0, 401)
    turn = np.where(times < 2.0, 0.5 * np.sin(np.pi * times / 2.0) ** 2, 0.0)
    _, psi, _ = lsim(([-1.0, 0.0], [1.0, 1.6 * w, w * w]), turn, times)
    wanted = float(np.abs(psi).max())
    assert excursion(HeadingControl(LIMIT, w), pulse(0.5)) == pytest.approx(wanted, rel=0.03)


def test_feed_forward_leaves_a_fifth_and_what_the_rotors_cannot_give() -> None:
    control, free = HeadingControl(LIMIT, 2.0, is_fed=True), HeadingControl(LIMIT, 2.0)
    fifth = excursion(free, 0.2 * pulse(0.5))
    assert excursion(control, pulse(0.5)) == pytest.approx(fifth, rel=1e-2)
    # The moment is 0.2 kg m^2 x 0.785 rad/s^2 at most, of which 0.8 are fed forward.
    assert excursion(control, pulse(0.5), room=0.16) == pytest.approx(fifth, rel=1e-2)
    assert excursion(control, pulse(0.5), room=0.08) > 2.0 * fifth


def test_no_motion_within_turn_max_exceeds_the_limit() -> None:
    """The worst motion switches its sign with the impulse response."""
    control = HeadingControl(LIMIT, 4.0)
    worst = 0.0
    for half in np.linspace(0.1, 1.0, 19):
        turn = control.turn_max * np.where(np.floor(TIMES / half) % 2 == 0, 1.0, -1.0)
        worst = max(worst, excursion(control, turn))
    assert 0.35 * LIMIT < worst < 0.41 * LIMIT, 'the remainder covers the limited moment'
    fed = HeadingControl(LIMIT, 4.0, is_fed=True)
    assert fed.turn_max == pytest.approx(2.0 * control.turn_max)


def test_the_momentum_of_an_unknown_payload_is_not_fed_forward() -> None:
    fed, unfed = HeadingControl(LIMIT, 4.0, is_fed=True), HeadingControl(LIMIT, 4.0)
    most = np.full(len(TIMES), 10.0)
    momentum, inertia = 0.02 * np.sin(3.0 * TIMES), np.full(len(TIMES), 0.2)
    carried = fed.excursion(TIMES, 0.0 * momentum, inertia, -most, most, momentum)
    assert carried > 0.01
    assert carried == unfed.excursion(TIMES, momentum, inertia, -most, most)
