"""Regressor, identifiable space and criteria against their definitions and differences."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.description.robot import Robot, load_robot
from aerarm_ros.excitation.criteria import (
    ConditionCriterion,
    DesignCriterion,
    IdentifiableSpace,
    InformationCriterion,
    SmoothRegressor,
    scaled_condition_number,
)
from aerarm_ros.excitation.trajectory import FourierTrajectory
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import JointReference


def states_of(trajectory: FourierTrajectory) -> JointReference:
    return trajectory.evaluate(np.linspace(0.0, 10.0, 40, endpoint=False))


def test_is_the_exact_regressor_away_from_standstill(
    robot: Robot, trajectory: FourierTrajectory
) -> None:
    states = states_of(trajectory)
    smooth = SmoothRegressor(robot, width=1e-9).stack(states)
    exact = Regressor(robot, rotor_inertia=True).stack(*states)
    np.testing.assert_allclose(smooth.reshape(exact.shape), exact, atol=1e-12)


def test_ranks_of_identifiable_spaces(robot: Robot, example_urdf: Callable[[str], Path]) -> None:
    tilted = load_robot(gravity_in_base=(3.0, 0.0, -9.3))
    ur10 = load_robot(example_urdf('ur10_robot.urdf'))
    for arm, columns, rank in (
        (robot, slice(0, 48), 30),  # thesis 5.3
        (robot, slice(None), 32),
        (tilted, slice(0, 48), 32),  # gravity across joint 1 shows two more
        (ur10, slice(0, 60), 36),  # six rotary joints, the first along gravity (Khalil)
    ):
        assert IdentifiableSpace.of_regressor(arm, SmoothRegressor(arm), columns).rank == rank


def test_every_trajectory_lies_in_the_space(robot: Robot, trajectory: FourierTrajectory) -> None:
    regressor = SmoothRegressor(robot)
    space = IdentifiableSpace.of_regressor(robot, regressor, slice(None))
    stacked = regressor.stack(trajectory.evaluate(np.linspace(0.0, 10.0, 200)))
    matrix = stacked.reshape(-1, stacked.shape[2])
    outside = matrix - matrix @ space.basis @ space.basis.T
    assert np.abs(outside).max() < 1e-9 * np.abs(matrix).max()
    assert np.linalg.matrix_rank(matrix[:, space.base_columns]) == space.rank


NOISE = np.array([0.17, 0.09, 0.08, 0.09])


@pytest.fixture(scope='module')
def regressor(robot) -> SmoothRegressor:
    return SmoothRegressor(robot)


@pytest.fixture(scope='module')
def space(robot, regressor: SmoothRegressor) -> IdentifiableSpace:
    return IdentifiableSpace.of_regressor(robot, regressor, slice(None))


@pytest.fixture(scope='module')
def thesis(robot, regressor: SmoothRegressor) -> ConditionCriterion:
    columns = regressor.thesis_columns
    return ConditionCriterion(
        IdentifiableSpace.of_regressor(robot, regressor, columns), columns, sharpness=20.0
    )


@pytest.fixture(scope='module')
def stacked(regressor: SmoothRegressor, trajectory: FourierTrajectory) -> np.ndarray:
    return regressor.stack(trajectory.evaluate(np.linspace(0.0, 10.0, 200, endpoint=False)))


def test_condition_number_is_that_of_the_non_zero_singular_values(thesis, stacked) -> None:
    matrix = stacked[:, :, :48].reshape(-1, 48)
    singular = np.linalg.svd(matrix, compute_uv=False)[:30]
    assert thesis.condition_number(stacked) == pytest.approx(singular[0] / singular[-1], rel=1e-6)
    # The softened logarithm is above the exact one, by little.
    assert 0.0 < thesis.evaluate(stacked)[0] - np.log(singular[0] / singular[-1]) < 0.2


def test_scaled_condition_number_ignores_units(space, stacked) -> None:
    units = np.random.default_rng(0).uniform(0.1, 10.0, stacked.shape[2])
    assert scaled_condition_number(space, stacked * units) == pytest.approx(
        scaled_condition_number(space, stacked), rel=1e-6
    )


def test_the_information_matrix_predicts_the_scatter_of_least_squares(space, stacked) -> None:
    """Monte Carlo: the scatter of least-squares estimates is the Cramer-Rao bound."""
    generator = np.random.default_rng(1)
    weighted = (stacked / NOISE[:, np.newaxis]).reshape(-1, stacked.shape[2])
    inverse = np.linalg.pinv(weighted, rcond=1e-9)
    estimates = inverse @ generator.normal(size=(len(weighted), 3000))
    scatter = np.cov(space.basis.T @ estimates)
    predicted = InformationCriterion(space, NOISE).evaluate(stacked)[0]
    mean_information = np.log(len(stacked))  # the criterion is that of one mean sample
    assert np.linalg.slogdet(scatter)[1] / space.rank + mean_information == pytest.approx(
        2.0 * predicted, abs=0.02
    )


def test_a_bounded_criterion_counts_twice_beyond_its_limit(space, thesis, stacked) -> None:
    value, information = thesis.evaluate(stacked)[0], InformationCriterion(space, NOISE)
    alone = information.evaluate(stacked)[0]
    below, above = (DesignCriterion(information, thesis, value + s) for s in (1.0, -1.0))
    assert below.evaluate(stacked)[0] == pytest.approx(alone, abs=1e-6)
    assert above.evaluate(stacked)[0] == pytest.approx(alone + 2.0)
