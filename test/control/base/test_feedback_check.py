"""Stability of loops through the drone: the largest delay of the joints' feedback."""

import numpy as np
import pytest

from aerarm_ros.control.base.feedback_check import largest_delay

CYCLE = 1e-4


def final_error(gain: float, kp: float, kd: float, delay: float) -> float:
    """Return the largest error in the last tenth of 1 s, from 1 at the start, with a delay."""
    late = round(delay / CYCLE)
    error, rate, asked, errors = 1.0, 0.0, [0.0] * late, []
    for _ in range(round(1.0 / CYCLE)):
        asked.append(-(1.0 + gain) * (kp * error + kd * rate))
        rate += CYCLE * asked.pop(0)
        error += CYCLE * rate
        errors.append(abs(error))
    return max(errors[-1000:])


@pytest.mark.parametrize(('gain', 'kp', 'kd'), [(9.1, 400.0, 40.0), (1.4, 900.0, 60.0)])
def test_feedback_is_stable_up_to_that_delay(gain: float, kp: float, kd: float) -> None:
    delay = largest_delay(gain, kp, kd)
    assert final_error(gain, kp, kd, 0.9 * delay) < 0.1
    assert final_error(gain, kp, kd, 1.1 * delay) > 10.0


def test_a_light_drone_reduces_the_tolerated_delay() -> None:
    delays = [largest_delay(gain, 400.0, 40.0) for gain in (0.0, 1.4, 5.6, 9.1)]
    np.testing.assert_allclose(1e3 * np.array(delays), [32.4, 15.2, 5.8, 3.8], atol=0.1)
    assert largest_delay(9.1, 0.0, 0.0) == np.inf
