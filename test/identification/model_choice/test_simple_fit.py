"""A simple model predicts parts of the motion from the others."""

from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot
from aerarm_ros.identification.conditioning.conditioning import Conditioner
from aerarm_ros.identification.conditioning.motion_check import ConditioningOptions
from aerarm_ros.identification.regression import SampleColumns
from aerarm_ros.identification.simple_fit import SimpleFit
from aerarm_ros.model.regressor import Regressor


@pytest.fixture(scope='module')
def bag(make_arm: Callable, robot: Robot) -> SampleColumns:
    recording = make_arm(rate=200.0, friction=0.0).recording(1)
    conditioner = Conditioner([recording], ConditioningOptions())
    return SampleColumns(
        conditioner.condition(recording, conditioner.candidates()[0]), Regressor(robot)
    )


def test_a_true_model_leaves_next_to_nothing(bag: SampleColumns, cad) -> None:
    fit = SimpleFit([bag], cad)
    for residuals, torque in (
        (fit.residuals()[0], bag.samples.tau),
        (fit.raw_residuals()[0], bag.samples.tau_raw),
    ):
        assert np.nanstd(residuals) < 0.01 * np.std(torque)


def test_a_torque_of_a_single_part_is_not_explained_by_the_others(bag: SampleColumns, cad) -> None:
    """A torque that only one part has cannot be learnt from the others."""
    samples = bag.samples
    before = SimpleFit([bag], cad).residuals()[0]
    samples.tau[samples.fold == 2, 1] += 3.0
    try:
        after = SimpleFit([bag], cad).residuals()[0]
    finally:
        samples.tau[samples.fold == 2, 1] -= 3.0
    added = (after - before)[samples.fold == 2, 1]
    assert np.mean(added) == pytest.approx(3.0, abs=0.1)


def test_the_coefficient_of_shared_columns_is_estimated(bag: SampleColumns, cad) -> None:
    samples = bag.samples
    wave = np.sin(7.0 * samples.time)[:, None] * np.array([1.0, 0.0, 2.0, 0.0])
    shared = samples.coarse_filter(wave)[:, :, None]
    added = 0.2 * shared[:, :, 0]
    samples.tau[:] += added
    try:
        fit = SimpleFit([bag], cad, [shared])
    finally:
        samples.tau[:] -= added
    assert fit.theta[10 * samples.n] == pytest.approx(0.2, abs=0.01)
