"""A simple model predicts parts of the motion from the others."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from aerarm_ros.identification.simple_fit import SimpleFit


def test_parts_are_predicted_from_the_others(make_arm: Callable, columns_of: Callable, cad) -> None:
    """What only one part has cannot be learnt; a column that all joints share can."""
    bag = columns_of(make_arm(rate=200.0, friction=0.0))
    samples, fit = bag.samples, SimpleFit([bag], cad)
    before = fit.residuals()[0]
    assert np.nanstd(before) < 0.01 * np.std(samples.tau)
    assert np.nanstd(fit.raw_residuals()[0]) < 0.01 * np.std(samples.tau_raw)
    rows = samples.fold == 2

    def with_torque(added: np.ndarray):
        return bag.altered(samples=replace(samples, tau=samples.tau + added))

    pushed = with_torque(3.0 * np.outer(rows, [0.0, 1.0, 0.0, 0.0]))
    after = SimpleFit([pushed], cad).residuals()[0]
    assert np.mean((after - before)[rows, 1]) == pytest.approx(3.0, abs=0.1)
    wave = np.sin(7.0 * samples.time)[:, None] * np.array([1.0, 0.0, 2.0, 0.0])
    shared = samples.coarse_filter(wave)
    moved = SimpleFit([with_torque(0.2 * shared)], cad, [shared[:, :, None]])
    assert moved.theta[10 * samples.n] == pytest.approx(0.2, abs=0.01)
