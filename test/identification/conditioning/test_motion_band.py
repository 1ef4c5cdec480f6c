"""The band of a motion, with and without measurement noise."""

import numpy as np
import pytest

from aerarm_ros.identification.conditioning.motion_band import motion_band

DT = 1.0 / 125.0
T = DT * np.arange(5000)


@pytest.mark.parametrize('noise', [0.0, 0.05])
def test_the_fastest_joint_decides(noise: float) -> None:
    dq = np.column_stack([np.sin(2 * np.pi * 0.2 * T), 0.5 * np.sin(2 * np.pi * 0.8 * T)])
    dq += noise * np.random.default_rng(0).standard_normal(dq.shape)
    assert motion_band(dq, DT) == pytest.approx(0.8, abs=0.1)


def test_a_joint_at_rest_does_not_matter() -> None:
    dq = np.column_stack([np.sin(2 * np.pi * 0.3 * T), np.zeros(len(T))])
    assert motion_band(dq, DT) == pytest.approx(0.3, abs=0.1)
    assert motion_band(np.zeros((100, 2)), DT) > 0.0
