"""Means over blocks keep what they are means of."""

import numpy as np

from aerarm_ros.identification.motor_bench.motor_friction import MotorRun


def test_blocks_of_a_straight_line() -> None:
    time = 5.0 + np.arange(0.0, 1.04, 1e-3)
    dq = 0.5 - 0.2 * (time - 5.0)
    sine, cosine, mean_dq, ddq, tau = MotorRun(0.5, time, np.zeros_like(time), dq, 3.0 * dq).blocks(
        0.1
    )
    assert len(mean_dq) == 10  # the rest of 0.04 s belongs to the last one
    np.testing.assert_allclose(ddq, -0.2, atol=1e-9)
    np.testing.assert_allclose(tau, 3.0 * mean_dq)
    np.testing.assert_allclose(cosine, 1.0)
    np.testing.assert_allclose(sine, 0.0)
