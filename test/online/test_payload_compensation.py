import numpy as np
import pytest

from aerarm_ros.model.inertia import minimum_eigenvalue
from aerarm_ros.online.information_filter import SPECK, ball
from aerarm_ros.online.payload_compensation import PayloadCompensation

STEP = 0.005
FOUND = ball(0.2, [0.1, 0.01, -0.02], 0.05)


def lead(hand_over: PayloadCompensation, seconds: float) -> np.ndarray:
    """Return all payloads of the transition, (M, 10)."""
    return np.array([hand_over.update(STEP) for _ in range(round(seconds / STEP))])


def test_the_payload_reaches_its_fraction_at_the_mass_rate_as_a_possible_body() -> None:
    hand_over = PayloadCompensation(0.8, 0.2, 1.0)
    hand_over.offer(FOUND)
    carried = lead(hand_over, 1.0)
    np.testing.assert_allclose(carried[-1], 0.8 * FOUND)
    assert np.diff(carried[:, 0]).max() == pytest.approx(0.2 * STEP)
    assert np.argmax(carried[:, 0] >= 0.16 - 1e-12) == pytest.approx(0.8 / STEP - 1, abs=1)
    assert min(minimum_eigenvalue(body) for body in carried) > 0.0


def test_a_put_down_payload_is_removed_gradually() -> None:
    hand_over = PayloadCompensation(1.0, 0.2, 1.0)
    hand_over.offer(FOUND)
    lead(hand_over, 2.0)
    hand_over.offer(ball(SPECK, np.zeros(3), 0.1))
    carried = lead(hand_over, 0.5)
    assert carried[-1, 0] == pytest.approx(0.1)
    # Errors on its way out are nobody's fault.
    assert not any(hand_over.judge(np.full(4, 1.0), np.full(4, 1.0), STEP) for _ in range(200))
    assert lead(hand_over, 1.0)[-1] == pytest.approx(0.0)


def test_a_payload_that_increases_errors_is_removed_until_the_estimate_changes() -> None:
    hand_over = PayloadCompensation(1.0, 0.2, 1.0)
    hand_over.offer(FOUND)
    lead(hand_over, 2.0)
    asked = np.array([0.0, 1.5, 0.0, 0.2])
    right, wrong = np.full(4, 0.05), asked + 0.02
    assert not any(hand_over.judge(right, asked, STEP) for _ in range(200))
    assert not any(hand_over.judge(wrong, asked, STEP) for _ in range(50))
    assert sum(hand_over.judge(wrong, asked, STEP) for _ in range(20)) == 1
    assert hand_over.is_undone
    hand_over.offer(1.1 * FOUND)
    assert lead(hand_over, 2.0)[-1] == pytest.approx(0.0)
    hand_over.offer(2.0 * FOUND)
    assert not hand_over.is_undone
    assert lead(hand_over, 3.0)[-1] == pytest.approx(2.0 * FOUND)
